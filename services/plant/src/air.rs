//! Air: drag, ambient turbulence, and the jet of a fan.
//!
//! ```text
//! a = at + ( Fj(p) − R diag(d) Rᵀ va − c ‖va‖ va − (G(p) − 1) T R e3 ) / m,   va = Rv − w
//! ```
//!
//! a acceleration in {I}, m/s²; at ambient turbulence, an acceleration independent of the mass; Fj force of the fan's
//! jet, N ([`Jet`]); va airspeed, m/s, and w the wind; d drag, N s/m, along each body axis: rotors in forward flight
//! have a drag linear in the velocity (J.-M. Kai et al., "Nonlinear feedback control of quadrotors exploiting first-order
//! drag effects", 2017); c parasitic drag of the body, N s²/m²; G ground effect ([`GroundEffect`]). p and v are those of
//! the centre of mass. All forces act there: the air exerts no torque.
//!
//! The time-dependent parts are held over a tick, in a [`Wind`].

mod dryden;
mod fan;
mod ground_effect;
mod jet;
mod ornstein_uhlenbeck;

use nalgebra::Vector3;
use scenario::Scenario;
use shared_types::noise::{Noise, Stream};
use vehicle_model::rigid_body::Motion;

pub use dryden::Dryden;
pub use fan::Fan;
pub use ground_effect::GroundEffect;
pub use jet::Jet;
pub use ornstein_uhlenbeck::OrnsteinUhlenbeck;

/// The air over the course of a flight.
#[derive(Clone, Debug)]
pub struct Air {
    drag: Vector3<f64>,
    parasitic_drag: f64,
    wind: Option<scenario::Wind>,
    gusts: Option<OrnsteinUhlenbeck>,
    dryden: Option<Dryden>,
    turbulence: Option<OrnsteinUhlenbeck>,
    fan: Option<Fan>,
    ground_effect: Option<GroundEffect>,
}

/// The air from one tick to the next.
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
    /// The ground effect, if there is any.
    pub ground_effect: Option<GroundEffect>,
}

/// State of the air's random processes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gusts {
    /// at in {I}, m/s².
    pub turbulence_world: Vector3<f64>,
    /// Gust of the wind in {I}, m/s.
    pub wind_world: Vector3<f64>,
    /// States of the Dryden gusts.
    pub dryden: [f64; 5],
    /// Fluctuation of the jet's force in {I}, as a share of it.
    pub jet_fluctuation_world: Vector3<f64>,
}

impl Air {
    /// Makes the air of a scenario at the start of the flight; `None` if it exerts no force.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Option<Self> {
        let vehicle = &scenario.vehicle;
        let tick = scenario.schedule.tick;
        let process = |config: &scenario::Turbulence, stream| {
            let noise = Noise::new(scenario.seed, stream);
            OrnsteinUhlenbeck::new(config.deviation, config.correlation_time, tick, noise)
        };
        let wind = vehicle.wind.as_ref();
        let gusts = wind.and_then(|wind| wind.gusts.as_ref());
        let dryden = wind.and_then(|wind| wind.dryden.as_ref().map(|config| (config, wind.mean.into())));
        let turbulence = vehicle.turbulence.as_ref();
        let air = Self {
            drag: vehicle.drag.into(),
            parasitic_drag: vehicle.parasitic_drag,
            wind: vehicle.wind.clone(),
            gusts: gusts.map(|config| process(config, Stream::Gusts)),
            dryden: dryden.map(|(config, mean)| {
                Dryden::new(config, &mean, tick, Noise::new(scenario.seed, Stream::Dryden))
            }),
            turbulence: turbulence.map(|config| process(config, Stream::Turbulence)),
            fan: vehicle
                .fan
                .as_ref()
                .map(|config| Fan::new(config, scenario.seed, tick)),
            ground_effect: vehicle.ground_effect.as_ref().map(GroundEffect::new),
        };
        let has_drag = air.drag != Vector3::zeros() || air.parasitic_drag != 0.0;
        let exerts_force =
            has_drag || air.turbulence.is_some() || air.fan.is_some() || air.ground_effect.is_some();
        exerts_force.then_some(air)
    }

    /// Advances the random processes by a tick, to `tick`.
    pub fn advance(&mut self, tick: u64) {
        if let Some(turbulence) = &mut self.turbulence {
            turbulence.advance(tick);
        }
        if let Some(gusts) = &mut self.gusts {
            gusts.advance(tick);
        }
        if let Some(dryden) = &mut self.dryden {
            dryden.advance(tick);
        }
        if let Some(fan) = &mut self.fan {
            fan.fluctuation.advance(tick);
        }
    }

    /// Returns the air at a flight time, s, with the current turbulence.
    #[must_use]
    pub fn wind(&self, time: f64) -> Wind {
        Wind {
            drag: self.drag,
            parasitic_drag: self.parasitic_drag,
            velocity_world: self.wind.as_ref().map(|wind| {
                let sine = Vector3::from(wind.sine) * libm::sin(wind.sine_frequency * time);
                let dryden = self.dryden.as_ref().map_or_else(Vector3::zeros, Dryden::value);
                Vector3::from(wind.mean) + sine + self.gusts().wind_world + dryden
            }),
            turbulence_world: self.gusts().turbulence_world,
            jet: self.fan.as_ref().map(|fan| fan.jet(time)),
            ground_effect: self.ground_effect,
        }
    }

    /// Returns the state of the random processes.
    #[must_use]
    pub fn gusts(&self) -> Gusts {
        let value = |process: Option<&OrnsteinUhlenbeck>| {
            process.map_or_else(Vector3::zeros, OrnsteinUhlenbeck::value)
        };
        Gusts {
            turbulence_world: value(self.turbulence.as_ref()),
            wind_world: value(self.gusts.as_ref()),
            dryden: self.dryden.as_ref().map_or([0.0; 5], Dryden::states),
            jet_fluctuation_world: value(self.fan.as_ref().map(|fan| &fan.fluctuation)),
        }
    }

    /// Restores a saved state.
    pub fn restore(&mut self, gusts: &Gusts) {
        if let Some(turbulence) = &mut self.turbulence {
            turbulence.restore(gusts.turbulence_world);
        }
        if let Some(process) = &mut self.gusts {
            process.restore(gusts.wind_world);
        }
        if let Some(dryden) = &mut self.dryden {
            dryden.restore(gusts.dryden);
        }
        if let Some(fan) = &mut self.fan {
            fan.fluctuation.restore(gusts.jet_fluctuation_world);
        }
    }
}

impl Wind {
    /// Returns a in {I}, m/s², for the motion of the centre of mass, the thrust (N) and the mass (kg).
    #[must_use]
    #[inline]
    pub fn acceleration(&self, motion: &Motion, thrust: f64, mass: f64) -> Vector3<f64> {
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
        if let Some(effect) = &self.ground_effect {
            force_world -= motion.world_from_body.column(2) * (effect.gain(motion.position_world.z) * thrust);
        }
        self.turbulence_world + force_world / mass
    }
}
