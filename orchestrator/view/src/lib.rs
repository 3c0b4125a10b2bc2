//! `gerono view`: a flight in a browser, live or afterwards.
//!
//! One page over plain HTTP, with updates as Server-Sent Events, which are one-way: a browser cannot send commands to
//! the flight. Programs with the Foxglove protocol receive the topics and can only subscribe. The samples come from the
//! run's orchestrator, which receives them anyway, so the services are not affected by watchers ([`run_client`]).
//!
//! * [`feed`]: polls the run and feeds the board;
//! * [`frame`], [`path`]: what the page draws, from samples and scenario;
//! * [`board`]: the newest message of each kind, for any number of readers;
//! * [`server`], `connections`, [`http`]: connections and their limits;
//! * [`foxglove`], [`websocket`]: all topics for other programs;
//! * [`site`], [`host_name`], [`token`]: access control; [`address`]: the printed address;
//! * [`page`]: the page and its content security policy;
//! * [`manners`]: lowest priority, and no use of the services' cores.
//!
//! Failure policy: a run that does not answer is shown as such and polled again. A client that does anything but read
//! is refused or cut off silently: no client can affect the terminal or another client.

pub mod address;
pub mod arguments;
pub mod board;
mod connections;
pub mod feed;
pub mod foxglove;
pub mod frame;
pub mod host_name;
pub mod http;
pub mod manners;
pub mod page;
pub mod path;
pub mod server;
pub mod site;
pub mod token;
pub mod websocket;

use std::io::IsTerminal;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc;
use std::time::Duration;

use command_line::exit::Exit;
use command_line::failure::Failure;
use command_line::interrupt;
use command_line::output::{log_path, note, print, print_as_it_is};

use flight::interrupt::Interrupt;
use reproduce::log_figures::LogFigures;
use run_client::LiveError;
use run_client::runs::MachineRun;

use arguments::View;
use board::Board;
use feed::Feed;
use host_name::HostNames;
use page::Page;
use server::{Content, Server};
use site::Site;
use token::Token;

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
        note(format_args!("{reason}; the page shows that part"));
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
    // Otherwise only this machine reaches the server. A permitted host name means a proxy, through which others do.
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
