//! A disk that fails, for any program: loaded before the C library (`LD_PRELOAD`), it lets calls fail that write to files below
//! the folder `FAULTY_FOLDER`. `FAULTY` says how: `full:N` all writes from the N-th on, `write:N` the N-th one, `sync:N` the N-th sync. With `stop:N` nothing
//! fails; the program is asked to end at the N-th sync, and has a moment for it.

#![cfg(target_os = "linux")]
#![expect(unsafe_code, reason = "functions of the C library are replaced")]

use std::ffi::{c_char, c_int, c_long, c_void};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use libc::{iovec, off64_t, size_t, ssize_t};

struct Fault {
    folder: String,
    kind: String,
    number: u64,
}

fn fault() -> Option<&'static Fault> {
    static FAULT: OnceLock<Option<Fault>> = OnceLock::new();
    let read = || {
        let text = std::env::var("FAULTY").ok()?;
        let (kind, number) = text.split_once(':')?;
        let folder = std::env::var("FAULTY_FOLDER").ok()?;
        Some(Fault { folder, kind: kind.to_owned(), number: number.parse().ok()? })
    };
    FAULT.get_or_init(read).as_ref()
}

/// Whether a call of a kind fails, with the error set.
fn fails(file: c_int, is_sync: bool) -> bool {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let of_syncs = |fault: &Fault| fault.kind == "sync" || fault.kind == "stop";
    let Some(fault) = fault().filter(|fault| of_syncs(fault) == is_sync) else { return false };
    let link = format!("/proc/self/fd/{file}\0");
    let mut path = [0_u8; 4096];
    // SAFETY: the path ends with a zero byte, and the buffer is as long as is said.
    let length = unsafe {
        libc::readlink(link.as_ptr().cast::<c_char>(), path.as_mut_ptr().cast::<c_char>(), path.len())
    };
    if length < 0 || !path[..length as usize].starts_with(fault.folder.as_bytes()) {
        return false;
    }
    let number = 1 + COUNT.fetch_add(1, Relaxed);
    if fault.kind == "stop" {
        if number == fault.number {
            // SAFETY: a signal to this process.
            unsafe { libc::kill(libc::getpid(), libc::SIGTERM) };
            std::thread::sleep(std::time::Duration::from_millis(300));
        }
        return false;
    }
    let fails = if fault.kind == "full" { number >= fault.number } else { number == fault.number };
    if fails {
        // SAFETY: the place of this thread's error number.
        unsafe { *libc::__errno_location() = if fault.kind == "full" { libc::ENOSPC } else { libc::EIO } };
    }
    fails
}

macro_rules! replace {
    ($($name:ident($file:ident $(, $argument:ident: $kind:ty)*) -> $result:ty, $call:ident, $is_sync:literal;)*) => {$(
        /// # Safety
        /// As the function of the C library of that name.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name($file: c_int $(, $argument: $kind)*) -> $result {
            if fails($file, $is_sync) {
                return -1;
            }
            // SAFETY: the caller's promises are those that the system asks for.
            unsafe { libc::syscall(libc::$call, c_long::from($file) $(, $argument)*) as $result }
        }
    )*};
}

replace! {
    write(file, bytes: *const c_void, count: size_t) -> ssize_t, SYS_write, false;
    writev(file, parts: *const iovec, count: c_long) -> ssize_t, SYS_writev, false;
    pwrite64(file, bytes: *const c_void, count: size_t, at: off64_t) -> ssize_t, SYS_pwrite64, false;
    pwrite(file, bytes: *const c_void, count: size_t, at: off64_t) -> ssize_t, SYS_pwrite64, false;
    fsync(file) -> c_int, SYS_fsync, true;
    fdatasync(file) -> c_int, SYS_fdatasync, true;
}
