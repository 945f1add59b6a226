//! A virtual display, and the viewer on it.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

/// One sample per pixel, trilinear, without shadows: these are most of what software adapters draw.
pub(crate) const QUICK_SETTINGS: &str =
    r#"{ "display": { "samples": 1, "anisotropy": 1 }, "light": { "has_shadows": false } }"#;

/// A running Xvfb; it ends with the value.
pub(crate) struct Display {
    server: Child,
    number: u32,
}

impl Display {
    /// Starts a display of its own; nothing, and a visible line, where the system has none or no Vulkan.
    pub(crate) fn start() -> Option<Self> {
        let has_vulkan =
            ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].iter().any(|n| std::env::var_os(n).is_some())
                || ["/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d"]
                    .iter()
                    .any(|folder| Path::new(folder).read_dir().is_ok_and(|mut files| files.next().is_some()));
        if !has_vulkan {
            fantex_test::skip("the window is not tested (no Vulkan driver is installed)");
            return None;
        }
        // Without -noreset the server starts over when its last client leaves, and does not answer the next one meanwhile.
        let arguments = ["-displayfd", "1", "-screen", "0", "1280x800x24", "-nolisten", "tcp", "-noreset"];
        let started =
            Command::new("Xvfb").args(arguments).stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let Ok(mut server) = started else {
            fantex_test::skip("the window is not tested (Xvfb is not installed)");
            return None;
        };
        let mut line = String::new();
        let stdout = server.stdout.take().unwrap();
        BufReader::new(stdout).read_line(&mut line).unwrap();
        let number = line.trim().parse().expect("Xvfb tells its number");
        let display = Self { server, number };
        display.wait_until_it_answers();
        Some(display)
    }

    /// The number is told before clients are let in.
    #[cfg(unix)]
    fn wait_until_it_answers(&self) {
        use std::io::{Read, Write};
        let socket = format!("/tmp/.X11-unix/X{}", self.number);
        // X11's connection setup: little-endian, protocol 11.0, no authorization. The first byte of the answer is 1 for yes.
        let setup = [b'l', 0, 11, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        let is_let_in = || -> std::io::Result<bool> {
            let (mut stream, mut answer) = (std::os::unix::net::UnixStream::connect(&socket)?, [0]);
            stream.write_all(&setup)?;
            stream.read_exact(&mut answer)?;
            Ok(answer[0] == 1)
        };
        while !is_let_in().unwrap_or(false) {
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
    }

    #[cfg(not(unix))]
    fn wait_until_it_answers(&self) {}

    /// As `DISPLAY` has it.
    #[cfg(target_os = "linux")]
    pub(crate) fn name(&self) -> String {
        format!(":{}", self.number)
    }

    /// Runs the viewer with a session until it ends. Files of the session and its pictures are in `folder`. Unless the arguments
    /// have settings, the scene is drawn as software adapters do it quickly.
    pub(crate) fn run(&self, folder: &Path, arguments: &[&str], steps: &str) -> Output {
        self.command(folder, arguments, steps).output().unwrap()
    }

    /// What [`run`](Self::run) runs.
    pub(crate) fn command(&self, folder: &Path, arguments: &[&str], steps: &str) -> Command {
        let session = folder.join("session.json");
        std::fs::write(&session, format!("{{\"is_unwatched\":true,\"steps\":[{steps}]}}")).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_fantex-app"));
        if !arguments.contains(&"--settings") {
            let settings = folder.join("quick.json");
            std::fs::write(&settings, QUICK_SETTINGS).unwrap();
            command.arg("--settings").arg(settings);
        }
        command
            .args(arguments)
            .args(["--size", "1000x700", "--session"])
            .arg(&session)
            .current_dir(folder)
            .env("DISPLAY", format!(":{}", self.number))
            .env("HOME", folder)
            // Software Vulkan compiles every shader once for all tests.
            .env("MESA_SHADER_CACHE_DIR", concat!(env!("CARGO_TARGET_TMPDIR"), "/shaders"))
            .env("XDG_RUNTIME_DIR", folder)
            .env_remove("WAYLAND_DISPLAY")
            .env_remove("XDG_DATA_HOME");
        command
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        // It may have ended by itself.
        self.server.kill().ok();
        self.server.wait().ok();
    }
}

/// Waits until a session has made a file.
#[cfg(target_os = "linux")]
pub(crate) fn wait_for(path: &Path) {
    let started = std::time::Instant::now();
    while !path.exists() {
        assert!(started.elapsed().as_secs() < 240, "{} does not come", path.display());
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
}
