//! Every file of the log reader's fuzzing corpus is read and recovered as it should be, as the fuzzer demands it.

use crate::fuzz;

use std::path::Path;

#[test]
fn the_corpus_is_read_and_recovered() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus");
    let harness = fuzz::Harness::default();
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        println!("{}", path.display());
        harness.check(&std::fs::read(path).unwrap());
        count += 1;
    }
    assert!(count >= 20, "only {count} inputs");
}
