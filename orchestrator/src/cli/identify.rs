//! Arguments of `gerono identify`.

use std::path::PathBuf;

use clap::Args;

/// Arguments of `gerono identify`.
#[derive(Debug, Args)]
pub struct Identify {
    /// The log (run.mcap), or the folder that holds it.
    pub log: PathBuf,
    /// Print JSON, for other programs.
    #[arg(long)]
    pub json: bool,
}

impl Identify {
    /// The end of `gerono identify --help`.
    pub const EXAMPLES: &str = "Examples:\n  \
        gerono run scenarios/fig3_6.toml --set 'vehicle.center_of_mass=[0.0, 0.0, -0.01]' --out runs/markers\n  \
        gerono identify runs/markers";
}
