//! A flight in a browser, live or afterwards.
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
