//! Every block of code of README, tutorial and how-tos runs: `sh` and `python` here, page by page in a folder
//! of its own, `rust` as a doctest of `catch_lab`. Blocks of `toml` are read; what is `text` is output, or a
//! command that no test can run.

use std::{
    env, fs,
    os::unix::fs::{PermissionsExt, symlink},
    path::{Path, PathBuf},
    process::{Command, Output},
};

use catch_body::{TriangleMesh, shape::Cuboid};
use nalgebra::Vector3;

use crate::{depth_scan, skipped_without};

/// Stands for cargo: what it would build is there already. CI itself runs the two commands of the README and
/// all examples.
const CARGO: &str = r#"#!/bin/sh
case "$*" in
    "build --release" | "test --workspace --release" | "install --locked --path crates/catch_cli") ;;
    "run --release") exec catchingbot ;;
    "run --release -- "*) shift 3; exec catchingbot "$@" ;;
    "run --release --example "*) test -f "crates/catch_cli/examples/$4.rs" ;;
    *) echo "cargo $*: the runner of documented commands does not know this" >&2; exit 1 ;;
esac
"#;

/// Pages whose blocks have a test of their own, because they need what has to be built first.
const ELSEWHERE: &[(&str, &str)] = &[
    ("own-cell-in-python.md", "crates/catch_py/tests/test_documents.py"),
    ("use-it-from-python.md", "crates/catch_py/tests/test_documents.py"),
];

/// A description of an object such as readers have.
const CAN: &str = r#"<sdf version="1.7"><model name="can"><link name="body">
<inertial><mass>0.35</mass><inertia><ixx>3.7e-4</ixx><iyy>3.7e-4</iyy><izz>2.0e-4</izz></inertia></inertial>
<visual name="surface"><geometry><cylinder><radius>0.033</radius><length>0.1</length></cylinder></geometry></visual>
</link></model></sdf>
"#;

#[test]
fn readme_runs() {
    run_page(&root().join("README.md"));
}

/// What README calls a miss is one.
#[test]
fn a_brain_that_ignores_the_latency_of_its_gripper_misses() {
    let readme = fs::read_to_string(root().join("README.md")).unwrap();
    let line = readme.lines().find(|line| line.contains("gripper_latency_s=0")).unwrap();
    let (line, _) = line.split_once('#').unwrap();
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_catchingbot"))
        .args(line.split_whitespace().skip(1))
        .args(["--out", folder.path().to_str().unwrap()])
        .output()
        .unwrap();
    assert!(crate::stdout(&output).contains("Not caught"), "{output:?}");
}

#[test]
fn tutorial_runs() {
    run_pages("docs/tutorial");
}

#[test]
fn how_tos_run() {
    run_pages("docs/how-to");
}

fn run_pages(folder: &str) {
    let mut pages: Vec<PathBuf> = fs::read_dir(root().join(folder)).unwrap().map(|it| it.unwrap().path()).collect();
    pages.sort();
    assert!(!pages.is_empty());
    for page in pages {
        let elsewhere = ELSEWHERE.iter().find(|(name, _)| page.ends_with(name));
        match elsewhere {
            Some((_, test)) => assert!(root().join(test).is_file(), "{}: {test} is missing", page.display()),
            None => run_page(&page),
        }
    }
}

fn run_page(page: &Path) {
    let folder = tempfile::tempdir().unwrap();
    for name in ["crates", "assets"] {
        symlink(root().join(name), folder.path().join(name)).unwrap();
    }
    fs::write(folder.path().join("scan.stl"), box_stl([60, 50, 90])).unwrap();
    let solid = TriangleMesh::cuboid(&Cuboid { centre: Vector3::zeros().into(), size: Vector3::new(0.06, 0.05, 0.09) });
    depth_scan::write(&folder.path().join("scan"), &solid);
    let models = folder.path().join("models");
    fs::create_dir_all(models.join("YcbBanana")).unwrap();
    fs::write(models.join("soup_can.sdf"), CAN).unwrap();
    fs::write(models.join("YcbBanana/model.sdf"), CAN).unwrap();
    let programs = folder.path().join(".bin");
    fs::create_dir(&programs).unwrap();
    let cargo = programs.join("cargo");
    fs::write(&cargo, CARGO).unwrap();
    fs::set_permissions(&cargo, fs::Permissions::from_mode(0o755)).unwrap();
    symlink(env!("CARGO_BIN_EXE_catchingbot"), programs.join("catchingbot")).unwrap();
    let path = env::join_paths([programs].into_iter().chain(env::split_paths(&env::var_os("PATH").unwrap()))).unwrap();
    let run = |program: &str, arguments: &[&str]| -> Output {
        Command::new(program)
            .args(arguments)
            .current_dir(folder.path())
            .env("PATH", &path)
            .env("PYTHONPATH", root().join("target/python"))
            // No browser opens.
            .env_remove("DISPLAY")
            .env_remove("WAYLAND_DISPLAY")
            .env_remove("WSL_DISTRO_NAME")
            .output()
            .unwrap_or_else(|fault| panic!("{program}: {fault}"))
    };
    for (language, code) in blocks(&fs::read_to_string(page).unwrap()) {
        let output = match language.as_str() {
            "sh" => run("sh", &["-eu", "-c", &code]),
            "python" if !run("python3", &["-c", "import polars"]).status.success() => {
                skipped_without("polars");
                continue;
            }
            "python" => run("python3", &["-c", &code]),
            "toml" => {
                let read: Result<toml::Table, _> = code.parse();
                assert!(read.is_ok(), "{}: {read:?}", page.display());
                continue;
            }
            "rust" => {
                let lab = fs::read_to_string(root().join("crates/catch_lab/src/lib.rs")).unwrap();
                let name = page.strip_prefix(root()).unwrap().display().to_string();
                assert!(lab.contains(&format!("\"../../../{name}\"")), "the doctests of catch_lab lack {name}");
                continue;
            }
            "text" => continue,
            other => panic!("{}: a block of `{other}`", page.display()),
        };
        let [out, err] = [&output.stdout, &output.stderr].map(|it| String::from_utf8_lossy(it).into_owned());
        assert!(output.status.success(), "{}:\n{code}\n{out}{err}", page.display());
    }
}

/// A box as STL, in millimetres.
fn box_stl(size: [u32; 3]) -> String {
    let corner = |i: usize| [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { size[axis] } else { 0 });
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let facet = |corners: [usize; 3]| {
        let vertices: String =
            corners.map(|i| corner(i).map(|it| it.to_string()).join(" ")).map(|it| format!("vertex {it}\n")).concat();
        format!("facet normal 0 0 0\nouter loop\n{vertices}endloop\nendfacet\n")
    };
    let facets: String = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).map(facet).collect();
    format!("solid scan\n{facets}endsolid scan\n")
}

/// The blocks of code of a page, with their languages.
fn blocks(page: &str) -> Vec<(String, String)> {
    let mut blocks: Vec<(String, String)> = Vec::new();
    let mut inside = false;
    for line in page.lines() {
        match line.trim_start().strip_prefix("```") {
            Some(language) => {
                inside = !inside;
                if inside {
                    blocks.push((language.to_owned(), String::new()));
                }
            }
            None if inside => {
                let (_, code) = blocks.last_mut().unwrap();
                code.push_str(line);
                code.push('\n');
            }
            None => {}
        }
    }
    blocks
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap().to_path_buf()
}
