//! The example's scenario with the library that was built beside this program, and the same law linked in.

use std::cell::Cell;
use std::path::PathBuf;

use plugin::abi;
use plugin::{Plugin, Setup};
use scenario::Scenario;
use shared_types::ServiceId;
use shared_types::service::ErasedService;

/// Returns the scenario of the example in C, for 5 s, with this library.
pub fn scenario() -> Scenario {
    let text = include_str!("../../../plugin_c/eight.toml");
    let text = text
        .replace("libpid.so", "libplugin_rust.so")
        .replace("duration = 20.0", "duration = 5.0");
    let mut scenario: Scenario = toml::from_str(&text).expect("a scenario");
    let program = std::env::current_exe().expect("this program's path");
    // Cargo builds it beside this program, and puts it one folder higher if it is asked for.
    let mut folders = program.ancestors().skip(1).map(PathBuf::from);
    let folder = folders.find(|folder| folder.join("libplugin_rust.so").exists());
    scenario.plugins.as_mut().expect("the library").folder = folder;
    scenario
}

/// Returns the controller from the library.
pub fn library() -> Box<dyn ErasedService> {
    registry::build(ServiceId::Controller, &scenario()).expect("the library")
}

/// Returns the same controller, linked in.
pub fn linked_in() -> Box<dyn ErasedService> {
    let asked = [Cell::new(0)];
    let setup = abi::Setup {
        scenario: std::ptr::null(),
        parameters: std::ptr::null(),
        parameter_count: 0,
        asked: asked.as_ptr(),
        math: &raw const plugin::math::MATH,
    };
    Box::new(plugin_rust::Pid::create(&Setup::new(&setup)).expect("a controller"))
}
