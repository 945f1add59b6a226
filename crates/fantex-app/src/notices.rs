//! Messages for the user.

use std::collections::VecDeque;

/// Most messages that are shown at a time. Errors go last.
const SHOWN: usize = 4;

/// Most messages that are kept for those who ask later.
const KEPT: usize = 200;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    Info,
    Warning,
    /// Something failed. Stays until it is dismissed, or four later errors have come.
    Error,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Notice {
    pub severity: Severity,
    /// One or two sentences.
    pub text: String,
    /// When it came, seconds.
    pub since: f64,
}

#[derive(Clone, Debug, Default)]
pub struct Notices {
    /// The frame's time in seconds.
    pub now: f64,
    shown: VecDeque<Notice>,
    /// All texts, oldest first.
    log: VecDeque<String>,
}

impl Notices {
    /// Shows a message. The same text twice is one message, with the time of the second.
    fn add(&mut self, severity: Severity, text: impl Into<String>) {
        let text = text.into();
        self.shown.retain(|notice| notice.text != text);
        if self.log.back() != Some(&text) {
            self.log.push_back(text.clone());
        }
        if self.log.len() > KEPT {
            self.log.pop_front();
        }
        self.shown.push_back(Notice { severity, text, since: self.now });
        while self.shown.len() > SHOWN {
            let is_passing = |notice: &Notice| notice.severity != Severity::Error;
            // The newest is shown in any case.
            let oldest = self.shown.iter().take(SHOWN).position(is_passing);
            self.shown.remove(oldest.unwrap_or(0));
        }
    }

    pub fn info(&mut self, text: impl Into<String>) {
        self.add(Severity::Info, text);
    }

    pub fn warning(&mut self, text: impl Into<String>) {
        self.add(Severity::Warning, text);
    }

    pub fn error(&mut self, text: impl Into<String>) {
        self.add(Severity::Error, text);
    }

    /// The messages on the screen, oldest first; old ones go.
    pub fn shown(&mut self) -> impl Iterator<Item = &Notice> {
        self.shown.retain(|notice| lifetime(notice.severity).is_none_or(|l| self.now - notice.since < l));
        self.shown.iter()
    }

    /// Seconds until the next message goes.
    pub fn wake_in(&self) -> Option<f64> {
        let left = |n: &Notice| lifetime(n.severity).map(|l| (n.since + l - self.now).max(0.0));
        self.shown.iter().filter_map(left).reduce(f64::min)
    }

    /// Takes a message from the screen, by its index among those shown.
    pub fn dismiss(&mut self, index: usize) {
        self.shown.remove(index);
    }

    /// Takes a message from the screen that is not so any more.
    pub fn take_back(&mut self, text: &str) {
        self.shown.retain(|notice| notice.text != text);
    }

    /// The last texts, oldest first.
    pub fn log(&self) -> impl Iterator<Item = &str> {
        self.log.iter().map(String::as_str)
    }
}

/// Seconds on the screen.
fn lifetime(severity: Severity) -> Option<f64> {
    match severity {
        Severity::Info => Some(4.0),
        Severity::Warning => Some(12.0),
        Severity::Error => None,
    }
}
