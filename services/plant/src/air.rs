//! Air: drag, turbulence everywhere, and the jet of a fan.
//!
//! ```text
//! a = at + ( Fj(p) − R diag(d) Rᵀ(Rv) ) / m
//! ```
//!
//! a acceleration in {I}, m/s²; at ambient turbulence, an acceleration independent of the mass; Fj force of the fan's
//! jet, N ([`Jet`]); d drag, N s/m, along each body axis: rotors that advance through air are dragged by a force linear
//! in the velocity (J.-M. Kai et al., "Nonlinear feedback control of quadrotors exploiting first-order drag effects",
//! 2017). p and v are those of the centre of mass, on which all of it acts: the air exerts no torque.
//!
//! The parts that depend on time are held over a tick: a [`Wind`].

mod fan;
mod jet;
mod ornstein_uhlenbeck;

use nalgebra::Vector3;
use scenario::Scenario;
use shared_types::noise::{Noise, Stream};
use vehicle_model::rigid_body::Motion;

pub use fan::Fan;
pub use jet::Jet;
pub use ornstein_uhlenbeck::OrnsteinUhlenbeck;

/// The air over the course of a flight.
#[derive(Clone, Debug)]
pub struct Air {
    drag: Vector3<f64>,
    turbulence: Option<OrnsteinUhlenbeck>,
    fan: Option<Fan>,
}

/// The air at a tick, and until the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wind {
    /// d along the body axes, N s/m.
    pub drag: Vector3<f64>,
    /// at in {I}, m/s².
    pub turbulence_world: Vector3<f64>,
    /// The fan's jet, if there is a fan.
    pub jet: Option<Jet>,
}

/// State of the air that continues from tick to tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gusts {
    /// at in {I}, m/s².
    pub turbulence_world: Vector3<f64>,
    /// Fluctuation of the jet's force in {I}, as a share of it.
    pub jet_fluctuation_world: Vector3<f64>,
}

impl Air {
    /// Makes the air of a scenario at the start of the flight; `None` if it exerts no force.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Option<Self> {
        let vehicle = &scenario.vehicle;
        let tick = scenario.schedule.tick;
        let air = Self {
            drag: vehicle.drag.into(),
            turbulence: vehicle.turbulence.as_ref().map(|stated| {
                let noise = Noise::new(scenario.seed, Stream::Turbulence);
                OrnsteinUhlenbeck::new(stated.deviation, stated.correlation_time, tick, noise)
            }),
            fan: vehicle
                .fan
                .as_ref()
                .map(|stated| Fan::new(stated, scenario.seed, tick)),
        };
        let exerts = air.drag != Vector3::zeros() || air.turbulence.is_some() || air.fan.is_some();
        exerts.then_some(air)
    }

    /// Advances the turbulence by a tick, to `tick`.
    pub fn advance(&mut self, tick: u64) {
        if let Some(turbulence) = &mut self.turbulence {
            turbulence.advance(tick);
        }
        if let Some(fan) = &mut self.fan {
            fan.fluctuation.advance(tick);
        }
    }

    /// Returns the air at a time of the flight, s, with the present turbulence.
    #[must_use]
    pub fn wind(&self, time: f64) -> Wind {
        Wind {
            drag: self.drag,
            turbulence_world: self.gusts().turbulence_world,
            jet: self.fan.as_ref().map(|fan| fan.jet(time)),
        }
    }

    /// Returns the state that a continuation needs.
    #[must_use]
    pub fn gusts(&self) -> Gusts {
        let value = |process: Option<&OrnsteinUhlenbeck>| {
            process.map_or_else(Vector3::zeros, OrnsteinUhlenbeck::value)
        };
        Gusts {
            turbulence_world: value(self.turbulence.as_ref()),
            jet_fluctuation_world: value(self.fan.as_ref().map(|fan| &fan.fluctuation)),
        }
    }

    /// Continues from a saved state.
    pub fn restore(&mut self, gusts: &Gusts) {
        if let Some(turbulence) = &mut self.turbulence {
            turbulence.restore(gusts.turbulence_world);
        }
        if let Some(fan) = &mut self.fan {
            fan.fluctuation.restore(gusts.jet_fluctuation_world);
        }
    }
}

impl Wind {
    /// Returns a in {I}, m/s², of a body of mass m (kg) whose centre moves like `motion`.
    #[must_use]
    #[inline]
    pub fn acceleration(&self, motion: &Motion, mass: f64) -> Vector3<f64> {
        let drag_body = self.drag.component_mul(&motion.velocity_body());
        let mut force_world = -(motion.world_from_body * drag_body);
        if let Some(jet) = &self.jet {
            force_world += jet.force(&motion.position_world);
        }
        self.turbulence_world + force_world / mass
    }
}
