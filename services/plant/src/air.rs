//! Air: drag, turbulence everywhere, and the jet of a fan.
//!
//! ```text
//! a = at + ( Fj(p) − R diag(d) Rᵀ va − c ‖va‖ va ) / m,   va = Rv − w
//! ```
//!
//! a acceleration in {I}, m/s²; at ambient turbulence, an acceleration independent of the mass; Fj force of the fan's
//! jet, N ([`Jet`]); va velocity through the air, m/s, and w the wind; d drag, N s/m, along each body axis: rotors that
//! advance through air are dragged by a force linear in the velocity (J.-M. Kai et al., "Nonlinear feedback control of
//! quadrotors exploiting first-order drag effects", 2017); c parasitic drag of the body, N s²/m². p and v are those of the centre of mass, on which all of it acts: the air exerts no torque.
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
    parasitic_drag: f64,
    wind: Option<scenario::Wind>,
    gusts: Option<OrnsteinUhlenbeck>,
    turbulence: Option<OrnsteinUhlenbeck>,
    fan: Option<Fan>,
}

/// The air at a tick, and until the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wind {
    /// d along the body axes, N s/m.
    pub drag: Vector3<f64>,
    /// c, N s²/m².
    pub parasitic_drag: f64,
    /// w in {I}, m/s; `None` in still air.
    pub velocity_world: Option<Vector3<f64>>,
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
    /// Gust of the wind in {I}, m/s.
    pub wind_world: Vector3<f64>,
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
            parasitic_drag: vehicle.parasitic_drag,
            wind: vehicle.wind.clone(),
            gusts: vehicle
                .wind
                .as_ref()
                .and_then(|wind| wind.gusts.as_ref())
                .map(|stated| {
                    let noise = Noise::new(scenario.seed, Stream::Gusts);
                    OrnsteinUhlenbeck::new(stated.deviation, stated.correlation_time, tick, noise)
                }),
            turbulence: vehicle.turbulence.as_ref().map(|stated| {
                let noise = Noise::new(scenario.seed, Stream::Turbulence);
                OrnsteinUhlenbeck::new(stated.deviation, stated.correlation_time, tick, noise)
            }),
            fan: vehicle
                .fan
                .as_ref()
                .map(|stated| Fan::new(stated, scenario.seed, tick)),
        };
        let drags = air.drag != Vector3::zeros() || air.parasitic_drag != 0.0;
        let exerts = drags || air.turbulence.is_some() || air.fan.is_some();
        exerts.then_some(air)
    }

    /// Advances the turbulence by a tick, to `tick`.
    pub fn advance(&mut self, tick: u64) {
        if let Some(turbulence) = &mut self.turbulence {
            turbulence.advance(tick);
        }
        if let Some(gusts) = &mut self.gusts {
            gusts.advance(tick);
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
            parasitic_drag: self.parasitic_drag,
            velocity_world: self.wind.as_ref().map(|wind| {
                let sine = Vector3::from(wind.sine) * libm::sin(wind.sine_frequency * time);
                Vector3::from(wind.mean) + sine + self.gusts().wind_world
            }),
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
            wind_world: value(self.gusts.as_ref()),
            jet_fluctuation_world: value(self.fan.as_ref().map(|fan| &fan.fluctuation)),
        }
    }

    /// Continues from a saved state.
    pub fn restore(&mut self, gusts: &Gusts) {
        if let Some(turbulence) = &mut self.turbulence {
            turbulence.restore(gusts.turbulence_world);
        }
        if let Some(process) = &mut self.gusts {
            process.restore(gusts.wind_world);
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
        let mut through_air_body = motion.velocity_body();
        if let Some(wind) = &self.velocity_world {
            through_air_body -= motion.world_from_body.tr_mul(wind);
        }
        let drag_body = self.drag.component_mul(&through_air_body);
        let mut force_world = -(motion.world_from_body * drag_body);
        if self.parasitic_drag != 0.0 {
            let through_air_world = motion.world_from_body * through_air_body;
            force_world -= through_air_world * (self.parasitic_drag * through_air_world.norm());
        }
        if let Some(jet) = &self.jet {
            force_world += jet.force(&motion.position_world);
        }
        self.turbulence_world + force_world / mass
    }
}
