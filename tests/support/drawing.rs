//! The adapter that tests of pictures draw with.

use city3d::render::{AdapterPreference, Context};

/// The software adapter; without one a test is skipped loudly, and fails in CI.
pub fn software() -> Option<Context> {
    match Context::headless(&AdapterPreference::Software) {
        Ok(context) => Some(context),
        Err(error) => {
            assert!(std::env::var_os("CI").is_none(), "pictures cannot be tested: {error}");
            eprintln!("SKIPPED: {error}");
            None
        }
    }
}
