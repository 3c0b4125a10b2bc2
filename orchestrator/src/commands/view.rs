//! `gerono view`: a flight in a browser.

use std::io::IsTerminal;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc;
use std::time::Duration;

use command_line::exit::Exit;
use command_line::interrupt;
use command_line::output::{note, print_as_it_is};
use flight::interrupt::Interrupt;
use reproduce::log_figures::LogFigures;
use run_client::LiveError;
use run_client::runs::MachineRun;
use view::board::Board;
use view::feed::Feed;
use view::host_name::HostNames;
use view::page::Page;
use view::server::{Content, Server};
use view::site::Site;
use view::token::Token;
use view::{address, manners};

use super::{Failure, log_path, print};
use crate::cli::View;

/// Timeout for browsers to receive the last messages.
const LAST_MESSAGES_LIMIT: Duration = Duration::from_secs(2);

/// Runs `gerono view`.
///
/// # Errors
/// [`Failure`] if the flight does not exist, or the port is taken.
pub fn view(arguments: &View) -> Result<Exit, Failure> {
    let interrupt = interrupt::install_in_terminal().map_err(Failure::trouble)?;
    match &arguments.log {
        Some(log) => show(log, arguments, &interrupt),
        None => watch(arguments, &interrupt),
    }
}

/// Serves the page of a finished flight.
fn show(log: &Path, arguments: &View, interrupt: &Interrupt) -> Result<Exit, Failure> {
    let (html, broken) =
        report::page(&log_path(log), &mut LogFigures::default()).map_err(Failure::trouble)?;
    if let Some(reason) = &broken {
        note(format_args!("{reason}; the page shows the part before it"));
    }
    let (server, site) = listen(arguments, false)?;
    print_url("", &server, &site);
    let content = Content {
        site,
        page: Page::new(html),
        board: None,
    };
    // A pipe that is never written: the server runs until a signal.
    let (never, _held) = std::io::pipe().map_err(Failure::trouble)?;
    match end(server.serve(&Arc::new(content), interrupt, &never))? {
        Exit::Success => Ok(Exit::of_logs(broken.is_none())),
        exit => Ok(exit),
    }
}

/// Serves the page of a live flight.
fn watch(arguments: &View, interrupt: &Interrupt) -> Result<Exit, Failure> {
    let found = find(arguments)?;
    let (server, site) = listen(arguments, true)?;
    let name = found.as_ref().map_or("the next flight", MachineRun::name);
    print_url(&format!("{name}: "), &server, &site);
    manners::use_idle_priority();
    let content = Arc::new(Content {
        site,
        page: Page::live(),
        board: Some(Board::default()),
    });
    let (finished, finishes) = std::io::pipe().map_err(Failure::trouble)?;
    let (stop, stopped) = mpsc::channel();
    let fed = Arc::clone(&content);
    let run = arguments.run.clone();
    let follows = arguments.follow;
    let feed = std::thread::spawn(move || {
        // Closes the pipe when the thread ends, also by a panic.
        let _finishes = finishes;
        if let Some(board) = &fed.board {
            let feed = Feed {
                run,
                follows,
                board,
                stop: stopped,
            };
            feed.run(found);
            board.end();
            board.await_no_reader(LAST_MESSAGES_LIMIT);
        }
    });
    let served = server.serve(&content, interrupt, &finished);
    drop(stop);
    let is_finished = matches!(served, Ok(None));
    if feed.join().is_ok() && is_finished {
        print("the run has ended\n");
    }
    end(served)
}

/// Returns the first run; `None` if it has to be waited for.
fn find(arguments: &View) -> Result<Option<MachineRun>, Failure> {
    match run_client::find_to_watch(arguments.run.as_deref(), "view") {
        Err(LiveError::NoneToWatch(_) | LiveError::Unseen(_)) if arguments.follow => Ok(None),
        found => found.map(Some).map_err(Failure::trouble),
    }
}

/// Opens the server's socket, and creates its access rules.
fn listen(arguments: &View, is_live: bool) -> Result<(Server, Site), Failure> {
    let address = arguments.bind.unwrap_or(Ipv4Addr::LOCALHOST.into());
    let server = Server::listen((address, arguments.port).into()).map_err(|error| {
        Failure::trouble(format!(
            "cannot listen at {}: {error}; choose another port with `--port`, or any free one with `--port 0`; an address \
             with `--bind` has to be this machine's",
            SocketAddr::from((address, arguments.port))
        ))
    })?;
    // By default only this machine can reach the server. A permitted host name means a proxy, through which others can.
    let is_for_others = arguments.bind.is_some() || !arguments.allow_host.is_empty();
    let token = is_for_others.then(|| Token::draw(server.address().port()));
    let site = Site {
        names: HostNames::of(address, &arguments.allow_host),
        token: token.transpose().map_err(Failure::trouble)?,
        is_live,
    };
    Ok((server, site))
}

/// Prints the page's URL, on a terminal also as a QR code if other machines can reach it.
fn print_url(name: &str, server: &Server, site: &Site) {
    let query = site.token.as_ref().map(Token::query).unwrap_or_default();
    let url = address::url(server.address(), &query);
    print(format!("{name}{url}\n"));
    let is_for_others = site.token.is_some() && std::io::stdout().is_terminal();
    if let Some(code) = address::qr_code(&url).filter(|_| is_for_others) {
        print_as_it_is(code);
    }
}

fn end(served: std::io::Result<Option<i32>>) -> Result<Exit, Failure> {
    match served.map_err(Failure::trouble)? {
        Some(signal) => Ok(Exit::Signal(signal)),
        None => Ok(Exit::Success),
    }
}
