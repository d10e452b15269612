//! Names and texts that others chose are shown, not obeyed: by terminals, spreadsheets and browsers.

use std::fs;

use crate::{catchingbot, stderr, stdout};

#[test]
fn names_are_no_commands() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let ball = stdout(&catchingbot(&["list", "--show", "tennis_ball"]));
    let (formula, markup) = (at("=1+1.toml"), at("a|b<img src=x>.toml"));
    for file in [&formula, &markup] {
        fs::write(file, &ball).unwrap();
    }
    let out = at("e");
    let output = catchingbot(&["eval", "--object", &formula, "--object", &markup, "--trials", "1", "--out", &out]);
    assert!(output.status.success(), "{}", stderr(&output));
    let report = fs::read_to_string(at("e/report.html")).unwrap();
    assert!(report.contains("a|b&lt;img src=x&gt;") && !report.contains("<img src=x>"), "{report}");
    let csv = fs::read_to_string(at("e/trials.csv")).unwrap();
    assert!(csv.contains("'=1+1,") && !csv.contains(",=1+1,"), "{csv}");

    let escape = at("e.toml");
    fs::write(&escape, format!("{ball}\n\"\\u001b]0;owned\\u0007\" = 1\n")).unwrap();
    for arguments in [["check", &escape], ["--object", &escape]] {
        let output = catchingbot(&arguments);
        assert_eq!(output.status.code(), Some(2));
        let said = stdout(&output) + &stderr(&output);
        assert!(said.contains("owned") && !said.contains(['\u{1b}', '\u{7}']), "{said:?}");
    }
}
