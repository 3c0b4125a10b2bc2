//! What an orchestrator becomes that cannot go on; see [`::postmortem`].

use super::Failure;
use crate::cli::{Host, Postmortem};
use ::postmortem::aftermath;
use command_line::exit::Exit;
use command_line::output::print_error;
use run_client::run_root;

/// Says what has happened, sees to the services, and removes what the run had in shared memory.
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
        cause += &format!("; programs flew in place of {}", external_services.join(", "));
    }
    let services_continue = arguments.host == Host::Realtime;
    let then = if services_continue {
        "Its services go on alone: they end the flight as `real_time.orchestrator_loss` says, or `gerono attach` takes it \
         over. This command waits until they have ended."
    } else {
        "Its services were ended."
    };
    print_error(format_args!(
        "\nthe orchestrator could not go on: {cause}\n{then} What was recorded is in {}; `gerono recover {0}` makes a \
         proper log of it.",
        arguments.out.display()
    ));
    aftermath::end_processes(services_continue);
    let swept = run_root::clean();
    if let Err(error) = &swept {
        print_error(format_args!(
            "what it had in shared memory could not be removed: {error}; `gerono clean` does so"
        ));
    }
    Err(Failure::trouble(format!("the flight was not completed: {cause}")))
}
