//! Every input of the fuzzer's corpus fulfils what the fuzzer demands.

#[path = "../../fuzz/src/lib.rs"]
mod fuzz;

#[test]
fn the_corpus_fulfils_what_the_fuzzer_demands() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/corpus");
    let mut seen = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        fuzz::check(&std::fs::read(entry.unwrap().path()).unwrap());
        seen += 1;
    }
    assert!(seen >= 10, "{seen}");
}
