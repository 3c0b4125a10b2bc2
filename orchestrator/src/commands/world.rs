//! `gerono world`: the hardware-in-the-loop simulator.

use std::time::Duration;

use radio_link::port::Target;
use runtime::deployment::{self, FIFO_PRIORITY};
use runtime::flight_clock::FlightClock;
use scenario::{CaptureSystem, Key, Problem, RadioProtocol, Scenario, ServiceDeployment};
use shared_types::service::nanoseconds;

use super::{Failure, load, print, scenario_name, schedule_of, write_json};
use crate::cli::HilSimulator as Arguments;
use command_line::exit::Exit;
use command_line::interrupt;
use command_line::output::note;
use hil_simulator::autopilot::Autopilot;
use hil_simulator::betaflight::Betaflight;
use hil_simulator::cameras::CameraSender;
use hil_simulator::radio::Radio;
use hil_simulator::receiver_input::ReceiverInput;
use hil_simulator::receivers::{ReceiverSender, ReceiversError};
use hil_simulator::record::Record;
use hil_simulator::summary::{self, Summary};
use hil_simulator::{HilSimulator, Sensing, Timing};
use run_log::run_folder::RunFolder;

/// Time from the creation of the simulator to its first tick.
const COUNTDOWN: Duration = Duration::from_millis(20);

/// `gerono world`.
///
/// # Errors
/// [`Failure`] if the scenario has no laboratory, or a port for the flight cannot be opened.
pub fn world(arguments: &Arguments) -> Result<Exit, Failure> {
    let scenario = load(&arguments.scenario)?;
    schedule_of(&scenario)?;
    let nominal = Timing::nominal(&scenario);
    let timing = Timing {
        capture_rate: arguments.capture_rate.unwrap_or(nominal.capture_rate),
        capture_latency: arguments.capture_latency.unwrap_or(nominal.capture_latency),
        radio_latency: arguments.radio_latency.unwrap_or(nominal.radio_latency),
    };
    let mut seen = scenario.clone();
    if arguments.by_hand && seen.capture_system().is_some() {
        // Receivers do not measure what a hand moves.
        seen.receivers = None;
    }
    let sensing = sensing(arguments, &seen, &timing)?;
    let onboard = onboard(arguments, &scenario, &timing)?;
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    let name = format!("{}-world", scenario_name(&arguments.scenario.scenario));
    let folder = RunFolder::create(arguments.out.as_deref(), &name).map_err(Failure::not_written)?;
    let clock = FlightClock::starting_in(COUNTDOWN, nanoseconds(scenario.schedule.tick));
    let record = Record::begin(&folder, &scenario, clock.start_ns).map_err(Failure::not_written)?;
    let world = HilSimulator::new(&scenario, clock, onboard, sensing, record);
    let world = world.map_err(|error| {
        // The folder is left unchanged for the next attempt.
        folder.remove_logs();
        folder.remove_if_empty();
        Failure::bad_input(error)
    })?;
    if arguments.fifo
        && let Err(failure) = use_fifo()
    {
        folder.remove_logs();
        folder.remove_if_empty();
        return Err(failure);
    }
    if !arguments.quiet {
        print(summary::introduction(&seen, &timing, arguments.betaflight));
    }
    let ticks = arguments
        .seconds
        .map_or(u64::MAX, |seconds| nanoseconds(seconds) / clock.tick_ns);
    let world = if arguments.by_hand {
        world.moved_by_hand()
    } else {
        world
    };
    let warn = |late| {
        if !arguments.quiet {
            note(summary::warning(&seen, late, arguments.fifo));
        }
    };
    let report = world.run(ticks, &interrupt, warn);
    let report = report.map_err(Failure::not_written)?;
    let summary = Summary::new(&report, clock.tick_ns);
    write_json(&folder.summary(), &summary)?;
    if !arguments.quiet {
        print(&summary);
        print(format!("results: {}\n", folder.path().display()));
    }
    Ok(Exit::Success)
}

/// Puts the simulator under `SCHED_FIFO`, with the services' priority. Its writer has started before and stays ordinary.
fn use_fifo() -> Result<(), Failure> {
    let settings = ServiceDeployment {
        priority: Some(FIFO_PRIORITY),
        ..ServiceDeployment::default()
    };
    let refused = deployment::apply(&settings).into_iter().next();
    refused.map_or(Ok(()), |refusal| {
        Err(Failure::trouble(format!("{refusal}; or leave out --fifo")))
    })
}

fn sensing(arguments: &Arguments, scenario: &Scenario, timing: &Timing) -> Result<Sensing, Failure> {
    let receivers = scenario.real_receivers();
    if arguments.by_hand && receivers.is_some() {
        return Err(Failure::bad_input(
            "only the poses of cameras are moved by hand; leave out --by-hand",
        ));
    }
    let cameras = match receivers {
        Some(_) if scenario.capture_system().is_none() => None,
        _ => Some(Box::new(cameras(scenario, timing)?)),
    };
    let receivers = receivers.map(|stated| ReceiverSender::open(scenario, stated).map(Box::new));
    let receivers = receivers.transpose().map_err(|error| match error {
        ReceiversError::Socket(_) => Failure::trouble(error),
        _ => Failure::bad_input(error),
    })?;
    Ok(Sensing { cameras, receivers })
}

fn cameras(scenario: &Scenario, timing: &Timing) -> Result<CameraSender, Failure> {
    let Some((system, stated)) = scenario.capture_system() else {
        let key: Key = ["motion_capture", "source"].into_iter().collect();
        let reason = "the scenario's flight simulates the laboratory itself";
        let systems = CaptureSystem::ALL.map(CaptureSystem::name);
        return Err(refused(key, reason, &format!("state {}", one_of(&systems))));
    };
    let period = (1.0 / (timing.capture_rate * scenario.schedule.tick)).round();
    if period < 1.0 {
        let reason = format!(
            "cameras capture at most once per tick of {} s",
            scenario.schedule.tick
        );
        return Err(Failure::bad_input(format!(
            "{reason}; give a lower --capture-rate"
        )));
    }
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a whole number of ticks, at least 1"
    )]
    let period = period as u64;
    CameraSender::open(system, stated, period, nanoseconds(timing.capture_latency)).map_err(Failure::trouble)
}

fn onboard(arguments: &Arguments, scenario: &Scenario, timing: &Timing) -> Result<Autopilot, Failure> {
    if arguments.betaflight {
        let betaflight = Betaflight::open(scenario, arguments.rotor_arm, arguments.rotor_torque);
        return betaflight.map(Autopilot::Betaflight).map_err(Failure::trouble);
    }

    let link = scenario.rc_output.as_ref();
    let stated = link.and_then(|link| Some((link, link.transmitter.as_ref()?)));
    let made = stated.and_then(|(link, transmitter)| {
        let radio = Radio::new(link, transmitter, nanoseconds(timing.radio_latency))?;
        Some((Target::new(link.link, transmitter)?, radio))
    });
    let Some((target, radio)) = made else {
        let key: Key = ["rc_output", "link"].into_iter().collect();
        let reason = "the scenario's radio link is simulated";
        let links = RadioProtocol::ALL.map(RadioProtocol::name);
        return Err(refused(key, reason, &format!("state {}", one_of(&links))));
    };
    let radio = match radio.protocol() {
        RadioProtocol::Crazyflie if arguments.require_arming => radio.requiring_arming(),
        _ if arguments.require_arming => {
            return Err(Failure::bad_input(
                "only a Crazyflie is armed by a request; leave out --require-arming",
            ));
        }
        _ => radio,
    };
    let line = ReceiverInput::open(&target).map_err(Failure::trouble)?;
    Ok(Autopilot::RateLoop(line, Box::new(radio)))
}

/// Formats a choice of words: "`a`, `b` or `c`".
fn one_of(words: &[&str]) -> String {
    let (last, others) = words.split_last().unwrap_or((&"", &[]));
    format!("`{}` or `{last}`", others.join("`, `"))
}

fn refused(key: Key, reason: &str, fix: &str) -> Failure {
    Failure::bad_input(Problem::new(key, reason, fix).to_string())
}
