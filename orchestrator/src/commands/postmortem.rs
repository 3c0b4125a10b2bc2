//! The post-mortem process, which an orchestrator becomes when it cannot continue; see [`::postmortem`].

use super::Failure;
use crate::cli::{Host, Postmortem};
use ::postmortem::aftermath;
use command_line::exit::Exit;
use command_line::output::print_error;
use run_client::run_root;

/// Reports the cause, ends or waits for the services, and removes the run's shared memory.
///
/// # Errors
/// [`Failure`], always: the flight has failed.
pub fn postmortem(arguments: &Postmortem) -> Result<Exit, Failure> {
    let mut cause = aftermath::describe(&arguments.cause);
    if !arguments.external_services.is_empty() {
        let external_services: Vec<_> = arguments
            .external_services
            .iter()
            .map(|external_service| format!("`{external_service}`"))
            .collect();
        cause += &format!("; external services: {}", external_services.join(", "));
    }
    let services_continue = arguments.host == Host::Realtime;
    let then = if services_continue {
        "Its services continue alone: they end the flight as `real_time.orchestrator_loss` states, or `gerono attach` takes it \
         over. This command waits until they have ended."
    } else {
        "Its services were ended."
    };
    print_error(format_args!(
        "\nthe orchestrator could not continue: {cause}\n{then} The recorded samples are in {}; `gerono recover {0}` recovers \
         the log.",
        arguments.out.display()
    ));
    aftermath::end_processes(services_continue);
    let swept = run_root::clean();
    if let Err(error) = &swept {
        print_error(format_args!(
            "its shared memory could not be removed: {error}; `gerono clean` removes it"
        ));
    }
    Err(Failure::trouble(format!("the flight was not completed: {cause}")))
}
