//! The duration of a tick with all services in one thread: Fig. 1's first seconds, with and without a log.

use std::convert::Infallible;
use std::path::Path;

use divan::Bencher;
use divan::counter::ItemsCount;
use host::in_process::{InProcess, TickSink};
use shared_types::Topic;

const TICKS: u64 = 10_000;

fn main() {
    divan::main();
}

struct Nowhere;

impl TickSink for Nowhere {
    type Error = Infallible;

    fn sample(&mut self, _topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        std::hint::black_box(bytes);
        Ok(())
    }
}

#[divan::bench]
fn ticks_not_recorded(bencher: Bencher) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/fig1.toml");
    let settings = [
        format!("duration={}.0", TICKS / 1000),
        "vehicle.change=[]".to_owned(),
    ];
    let scenario = scenario_file::load(&file, &settings, None).expect("the scenario is in order");
    let schedule = scenario.schedule().expect("the scenario is in order");
    bencher
        .counter(ItemsCount::new(TICKS))
        .with_inputs(|| {
            let services = registry::build_all(&scenario).expect("the scenario is in order");
            InProcess::new(schedule.clone(), services)
        })
        .bench_local_refs(|host| host.fly(&mut Nowhere).is_ok());
}
