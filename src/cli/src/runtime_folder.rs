//! Restarts the program with `XDG_RUNTIME_DIR` set, so that libwayland prints no error.
//!
//! Mesa's Vulkan layer for the choice of a device (`VK_LAYER_MESA_device_select`) looks for a Wayland display whenever
//! an adapter is opened, and libwayland writes `error: XDG_RUNTIME_DIR is invalid or not set in the environment.` to
//! standard error where the variable names no absolute path: in containers, over ssh, in CI. A process cannot change its
//! own environment safely, so it starts again with the variable set.

/// Starts the program again, as the same process, with the runtime folder of its user, where it has none. The folder
/// need not exist: then there is no Wayland display, which is no fault. Goes on where that is not possible.
#[cfg(target_os = "linux")]
pub fn provide() {
    use std::os::unix::fs::MetadataExt;
    use std::os::unix::process::CommandExt;
    const VARIABLE: &str = "XDG_RUNTIME_DIR";
    if std::env::var_os(VARIABLE).is_some_and(|folder| std::path::Path::new(&folder).is_absolute()) {
        return;
    }
    // What stands there belongs to the user of the process.
    let Ok(process) = std::fs::metadata("/proc/self") else { return };
    let mut arguments = std::env::args_os();
    let Some(name) = arguments.next() else { return };
    let error = std::process::Command::new("/proc/self/exe")
        .arg0(name)
        .args(arguments)
        .env(VARIABLE, format!("/run/user/{}", process.uid()))
        .exec();
    tracing::debug!("{VARIABLE} is not set: {error}");
}

#[cfg(not(target_os = "linux"))]
pub fn provide() {}
