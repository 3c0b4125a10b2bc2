//! `gerono-bench`: benchmarks for developers of Gerono; `gerono bench` has those for users.

use std::process::ExitCode;

use bench::arguments::GeronoBench;
use clap::Parser;
use command_line::exit::Exit;
use command_line::interrupt::ignore_file_size_signal;
use command_line::output;

fn main() -> ExitCode {
    if let Err(error) = ignore_file_size_signal() {
        output::print_error(error);
        return Exit::Trouble.into();
    }
    let result = bench::member::run().unwrap_or_else(|| bench::bench(&GeronoBench::parse()));
    output::conclude(result.map(|()| Exit::Success))
}
