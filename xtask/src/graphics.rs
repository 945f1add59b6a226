//! What tests of the GPU renderer and the viewer need from the system: a Vulkan driver and a virtual display.

use std::path::Path;
use std::process::Command;

use crate::shell::{self, succeeds};

/// Debian's packages: software Vulkan, a virtual display, and the libraries that a window loads at run time.
const PACKAGES: [&str; 9] = [
    "mesa-vulkan-drivers",
    "libvulkan1",
    "xvfb",
    "libx11-6",
    "libx11-xcb1",
    "libxcursor1",
    "libxi6",
    "libxkbcommon0",
    "libxkbcommon-x11-0",
];

/// Where drivers register.
const DRIVER_FOLDERS: [&str; 4] = [
    "/usr/share/vulkan/icd.d",
    "/etc/vulkan/icd.d",
    "/usr/local/share/vulkan/icd.d",
    "/usr/local/etc/vulkan/icd.d",
];

/// Sees to it that GPU tests can run: installs what is missing where that is possible without asking anybody (as root, where
/// there is `apt-get`), and says what is missing elsewhere.
pub(crate) fn prepare(skipped: &mut Vec<String>) {
    if !cfg!(target_os = "linux") || (has_vulkan() && has_display()) {
        return;
    }
    if is_root() && succeeds(Command::new("apt-get").arg("--version")) {
        eprintln!("> apt-get install {}", PACKAGES.join(" "));
        if !install() {
            // The package lists may be old or missing.
            let updated = shell::run(Command::new("apt-get").args(["update", "-qq"])).is_ok();
            if !(updated && install()) {
                eprintln!("these packages could not be installed");
            }
        }
    }
    let packages = PACKAGES.join(" ");
    if !has_vulkan() {
        skipped.push(format!("tests on a GPU: no Vulkan driver was found; on Debian install {packages}"));
    }
    if !has_display() {
        skipped.push(format!("tests of the window: Xvfb is not installed; on Debian install {packages}"));
    }
}

fn install() -> bool {
    let mut command = Command::new("apt-get");
    command.args(["install", "-y", "-qq", "--no-install-recommends"]).args(PACKAGES);
    shell::run(command.env("DEBIAN_FRONTEND", "noninteractive")).is_ok()
}

fn is_root() -> bool {
    shell::capture(Command::new("id").arg("-u")).is_ok_and(|id| id.trim() == "0")
}

fn has_vulkan() -> bool {
    ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].iter().any(|name| std::env::var_os(name).is_some())
        || DRIVER_FOLDERS
            .iter()
            .any(|folder| Path::new(folder).read_dir().is_ok_and(|mut files| files.next().is_some()))
}

fn has_display() -> bool {
    succeeds(Command::new("sh").args(["-c", "command -v Xvfb"]))
}
