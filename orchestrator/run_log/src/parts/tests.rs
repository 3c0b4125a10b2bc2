//! Names of the files of a log.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use super::*;

#[test]
fn names_tell_the_log_and_the_number() {
    let named = |name: &str| Name::of(Path::new(name)).map(|name| (name.common, name.number, name.make));
    let run = |number, make| Some(("run".to_owned(), number, make));
    assert_eq!(named("run.mcap"), run(0, Make::Complete));
    assert_eq!(named("runs/x/run.12.mcap"), run(12, Make::Complete));
    assert_eq!(named("run.2.mcap.partial"), run(2, Make::Partial));
    assert_eq!(named("run.2.recovered.mcap"), run(2, Make::Recovered));
    for other in ["run.01.mcap", "run.0.mcap", "run.view.mcap", "run.+1.mcap"] {
        assert_ne!(named(other).unwrap().0, "run", "{other}");
    }
    assert_eq!(named("summary.json"), None);
}

#[test]
fn the_files_of_a_log_come_in_the_order_of_their_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let first = folder.path().join("run.mcap");
    let names = [
        "run.mcap",
        "run.2.mcap",
        "run.2.recovered.mcap",
        "run.10.mcap.partial",
        "host.mcap",
        "run.view.mcap",
        "other.1.mcap",
    ];
    for name in names {
        std::fs::write(folder.path().join(name), "").unwrap();
    }
    let numbers = |paths: Vec<PathBuf>| -> Vec<_> {
        let names = paths.into_iter();
        names
            .map(|path| path.file_name().unwrap().to_str().unwrap().to_owned())
            .collect()
    };
    let after = files_after(&first).into_iter().map(|(_, path)| path).collect();
    assert_eq!(numbers(after), ["run.2.recovered.mcap", "run.10.mcap.partial"]);
    let written = written_files(&first);
    assert_eq!(
        numbers(written),
        ["run.mcap", "run.2.mcap", "run.10.mcap.partial"]
    );
    assert!(has_recovered(&first));
    assert_eq!(
        part_beside(&folder.path().join("run.2.mcap.partial"), 3),
        folder.path().join("run.3.mcap")
    );
}
