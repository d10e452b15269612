//! Opens pages in a browser of this machine.

use std::{
    env,
    ffi::OsStr,
    fs,
    path::Path,
    process::{Command, Stdio},
};

/// Shows an address in a browser, if there is a display.
pub fn open_address(address: &str) {
    if has_display() {
        open_with(OsStr::new(address));
    }
}

/// Returns whether a browser has a display.
pub fn has_display() -> bool {
    let is_set = |name: &str| env::var_os(name).is_some_and(|it| !it.is_empty());
    !cfg!(all(unix, not(target_os = "macos")))
        || ["DISPLAY", "WAYLAND_DISPLAY", "WSL_DISTRO_NAME"].into_iter().any(is_set)
}

/// Asks the system to show a file; whether there was anybody to ask.
pub fn open(page: &Path) -> bool {
    // An absolute path cannot be taken for an option.
    let page = fs::canonicalize(page).unwrap_or_else(|_| page.to_owned());
    open_with(page.as_os_str())
}

fn open_with(what: &OsStr) -> bool {
    let openers: &[&[&str]] = if cfg!(target_os = "macos") {
        &[&["open"]]
    } else if cfg!(target_os = "windows") {
        &[&["explorer"]]
    } else {
        &[&["xdg-open"], &["gio", "open"], &["wslview"], &["sensible-browser"]]
    };
    let quiet = |opener: &&[&str]| {
        let [program, options @ ..] = opener else { return false };
        let mut command = Command::new(program);
        command.args(options).arg(what).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        command.spawn().is_ok()
    };
    openers.iter().any(quiet)
}
