//! The header in the repository is that of this program, and compiles as C and as C++.

use std::path::Path;
use std::process::Command;

const PATH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/include/gerono.h");

#[test]
fn the_header_in_the_repository_is_that_of_this_program() {
    let text = plugin::header::text();
    if std::env::var_os("GERONO_BLESS").is_some() {
        std::fs::write(PATH, &text).unwrap();
    }
    let stored = std::fs::read_to_string(PATH).unwrap();
    assert!(stored == text, "{PATH} is out of date: run with GERONO_BLESS=1");
}

#[test]
fn the_header_compiles_as_c_and_as_cpp() {
    for language in ["c", "c++"] {
        let mut command = Command::new("cc");
        command.args(["-x", language, "-fsyntax-only", "-Wall", "-Wextra", "-Werror"]);
        let output = command
            .arg(Path::new(PATH))
            .output()
            .expect("a C compiler links Rust too");
        let complaint = String::from_utf8_lossy(&output.stderr);
        let lacks = complaint.contains("cc1plus");
        assert!(output.status.success() || lacks, "{language}: {complaint}");
    }
}
