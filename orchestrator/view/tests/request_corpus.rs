//! Every file of the fuzzing corpus of requests is answered as it should be, as the fuzzer demands it.

#[path = "../fuzz/src/lib.rs"]
mod fuzz;

use std::path::Path;

#[test]
fn every_request_of_the_corpus_is_answered_as_it_should_be() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus");
    let mut checked = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        fuzz::check(&std::fs::read(entry.unwrap().path()).unwrap());
        checked += 1;
    }
    assert!(checked >= 10, "{checked} requests");
}
