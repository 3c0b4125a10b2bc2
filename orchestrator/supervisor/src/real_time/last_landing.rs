//! Landing at the end of `duration`: a flight of a real vehicle ends only on the ground.

use shared_types::samples::{PathReference, VehicleState};
use shared_types::service::seconds;

use super::Flight;
use decisions::shutdown::Shutdown;
use run_client::newest::Newest;

impl Flight<'_> {
    /// Requests the landing of a real vehicle in time.
    pub(super) fn land_before_the_end(&mut self) {
        let (Some(phases), Some(left)) = (&self.scenario.flight, self.time_to_the_end()) else {
            return;
        };
        let Some(reference) = self.recorder.newest::<PathReference>() else {
            return;
        };
        let state = self.recorder.newest::<VehicleState>();
        // While it is not tracked, the last position counts.
        if let Some(state) = state.filter(|state| state.tracked.is_set()) {
            [.., self.vehicle_z] = state.position_world;
        }
        if !reference.airborne.is_set() {
            self.ground_z = self.vehicle_z;
        } else if self.conduct.shutdown() == Shutdown::None
            && left < phases.landing_time(self.ground_z - self.vehicle_z)
        {
            let answer = self.request_end("the end of `duration`");
            let text = format!("the flight ends in {left:.0} s, its `duration`: {answer}");
            self.announce(text);
        }
    }

    /// Returns the time left for a real vehicle, s; `None` for a simulated one, whose world ends with the flight.
    pub(super) fn time_to_the_end(&self) -> Option<f64> {
        let last_ns = self.schedule.time_ns(self.schedule.last_tick());
        let left = seconds(last_ns) - seconds(self.clock.elapsed_ns());
        (!self.schedule.simulates_the_world()).then_some(left)
    }
}
