//! What every command is told about its terminal, and what it comes to.

use clap::Args;

/// What a command came to: nothing to say, or in which respect its result falls short.
pub type Outcome = anyhow::Result<Option<String>>;

/// Options that every command takes.
#[derive(Debug, Clone, Args)]
pub struct Terminal {
    /// Print one JSON object on stdout; everything else goes to stderr.
    #[arg(long, global = true)]
    pub json: bool,
    /// Seed of everything random.
    #[arg(long, global = true, default_value_t = 1)]
    pub seed: u64,
    /// Say more.
    #[arg(short, long, global = true)]
    pub verbose: bool,
    /// Say nothing but results; no progress bars.
    #[arg(short, long, global = true)]
    pub quiet: bool,
}
