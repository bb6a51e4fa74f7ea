//! Loss of the display: where the connection to the display server breaks, winit panics, or Xlib ends the process by
//! `exit(1)`. The run has to end in order in both cases.

use city3d_session::SessionStopper;
use std::cell::RefCell;
use std::io::Write;
use std::panic::{self, AssertUnwindSafe, PanicHookInfo};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

/// Limit of the time in which a session ends and finishes its files.
const ENDS_WITHIN: Duration = Duration::from_secs(10);

thread_local! {
    /// `exit` destroys the thread's local values, whoever calls it.
    static ON_EXIT: RefCell<ExitGuard> = const { RefCell::new(ExitGuard { open_window: None }) };
}

/// Ends the session of the open window when the process ends beneath it.
struct ExitGuard {
    /// `Some` while a window is open, with the session that runs in it.
    open_window: Option<Option<SessionStopper>>,
}

impl Drop for ExitGuard {
    fn drop(&mut self) {
        let Some(session) = self.open_window.take() else { return };
        let is_whole = session.is_none_or(|session| session.stop_within(ENDS_WITHIN));
        let files = if is_whole { "its files are whole" } else { "its files may not be whole" };
        let _ = writeln!(
            std::io::stderr(),
            "the display is gone, and the window with it; what ran in it was stopped, and {files}"
        );
        // Not to the end of `exit`: it takes the software driver's compiler apart while threads still compile shaders.
        signal_hook::low_level::exit(1);
    }
}

/// From now on, the end of the process ends a session first; for the thread of the event loop.
pub fn guard_session(session: Option<SessionStopper>) {
    ON_EXIT.with_borrow_mut(|guard| guard.open_window = Some(session));
}

/// Ends [`guard_session`]: the window has closed.
fn release() {
    ON_EXIT.with_borrow_mut(|guard| guard.open_window = None);
}

/// Crates that talk to the display server, as their source folders begin.
const WINDOW_SYSTEM: [&str; 6] = ["winit-", "x11rb-", "x11-dl-", "wayland-", "smithay-", "calloop-"];

/// Calls a function. Where a crate of the window system panics in it, gives the words of the panic, which are not
/// printed; other panics go on.
pub fn catch_display_loss<T>(call: impl FnOnce() -> T) -> Result<T, String> {
    let lost = Arc::new(Mutex::new(None));
    let previous: Arc<dyn Fn(&PanicHookInfo<'_>) + Send + Sync> = Arc::from(panic::take_hook());
    let (slot, others, this_thread) = (Arc::clone(&lost), Arc::clone(&previous), thread::current().id());
    panic::set_hook(Box::new(move |info| {
        if thread::current().id() == this_thread && is_of_window_system(info) {
            *slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(words(info));
        } else {
            others(info);
        }
    }));
    let outcome = panic::catch_unwind(AssertUnwindSafe(call));
    release();
    panic::set_hook(Box::new(move |info| previous(info)));
    let words = lost.lock().unwrap_or_else(PoisonError::into_inner).take();
    match (outcome, words) {
        (Ok(result), _) => Ok(result),
        (Err(_), Some(words)) => Err(words),
        (Err(panic), None) => panic::resume_unwind(panic),
    }
}

fn is_of_window_system(info: &PanicHookInfo<'_>) -> bool {
    info.location().is_some_and(|location| is_in_window_system(location.file()))
}

/// Whether a source file belongs to a crate of the window system.
fn is_in_window_system(file: &str) -> bool {
    let mut folders = file.split(['/', '\\']);
    folders.any(|folder| WINDOW_SYSTEM.iter().any(|start| folder.starts_with(start)))
}

fn words(info: &PanicHookInfo<'_>) -> String {
    info.payload_as_str().unwrap_or("the connection to the display server broke").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panics_of_the_window_system_are_told_apart_by_their_crate() {
        let registry = "/home/me/.cargo/registry/src/index.crates.io-1949cf8c6b5b557f";
        assert!(is_in_window_system(&format!("{registry}/winit-0.30.13/src/platform_impl/linux/x11/mod.rs")));
        assert!(is_in_window_system(&format!("{registry}/x11rb-0.13.2/src/lib.rs").replace('/', "\\")));
        assert!(!is_in_window_system(&format!("{registry}/wgpu-30.0.1/src/api/surface.rs")));
        assert!(!is_in_window_system("src/viewer/src/window/event_loop.rs"));
    }

    #[test]
    fn other_panics_go_on() {
        assert_eq!(catch_display_loss(|| 7), Ok(7));
        let other = panic::catch_unwind(|| catch_display_loss(|| panic!("a defect of ours")));
        assert_eq!(other.unwrap_err().downcast_ref(), Some(&"a defect of ours"));
    }
}
