//! `--force`: leave to write over the results of earlier commands.

use city3d_session::Overwrite;
use clap::Args;

/// Option to overwrite existing results.
#[derive(Clone, Copy, Debug, Default, Args)]
pub struct OverwriteArgs {
    /// Write over the results of an earlier command in --out
    #[arg(long)]
    pub force: bool,
}

impl OverwriteArgs {
    pub fn policy(self) -> Overwrite {
        if self.force { Overwrite::Replace } else { Overwrite::Refuse }
    }
}
