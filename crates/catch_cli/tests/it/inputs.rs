//! Inputs that a reader of only the docs and `--help` would try, and their results.

use std::process::Command;

#[test]
fn inputs_end_as_the_table_says() {
    let folder = tempfile::tempdir().unwrap();
    let rows = include_str!("inputs.txt").lines().filter(|it| !it.starts_with('#'));
    let mut tried = 0;
    for row in rows {
        let mut columns = row.split(" | ");
        let mut next = || columns.next().unwrap_or_else(|| panic!("three columns: {row}"));
        let (code, arguments, says) = (next(), next(), next());
        let output = Command::new(env!("CARGO_BIN_EXE_catchingbot"))
            .args(arguments.split(' '))
            .current_dir(folder.path())
            .output()
            .unwrap();
        let [out, err] = [output.stdout, output.stderr].map(|it| String::from_utf8(it).unwrap());
        assert_eq!(output.status.code().map(|it| it.to_string()).as_deref(), Some(code), "{row}: {out}{err}");
        assert!(out.contains(says) || err.contains(says), "{row}: {out}{err}");
        assert!(!err.contains("panicked") && err.len() < 2000, "{row}: {err}");
        tried += 1;
    }
    assert!(tried >= 50, "{tried}");
}
