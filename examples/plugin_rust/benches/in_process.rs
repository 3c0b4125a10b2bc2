//! A flight of 5 s in one process, without a log: the controller from its library, and the same law linked in.
//!
//! ```console
//! $ cargo bench -p plugin_rust
//! ```

#[path = "../tests/support/mod.rs"]
mod support;

use std::convert::Infallible;

use divan::Bencher;
use host::in_process::{InProcess, TickSink};
use shared_types::service::ErasedService;
use shared_types::{ServiceId, Topic};

struct Nowhere;

impl TickSink for Nowhere {
    type Error = Infallible;

    fn sample(&mut self, _topic: Topic, _bytes: &[u8]) -> Result<(), Infallible> {
        Ok(())
    }
}

fn flight(bencher: Bencher<'_, '_>, controller: impl Fn() -> Box<dyn ErasedService> + Sync) {
    let scenario = support::scenario();
    bencher
        .with_inputs(|| {
            let mut services = registry::build_all(&scenario).expect("a scenario in order");
            services[ServiceId::Controller.index()] = controller();
            InProcess::new(scenario.schedule().expect("a schedule"), services)
        })
        .bench_values(|mut host| host.fly(&mut Nowhere).is_ok());
}

#[divan::bench(sample_count = 200)]
fn library(bencher: Bencher<'_, '_>) {
    flight(bencher, support::library);
}

#[divan::bench(sample_count = 200)]
fn linked_in(bencher: Bencher<'_, '_>) {
    flight(bencher, support::linked_in);
}

fn main() {
    divan::main();
}
