//! Numbers as text.

use fantex_app::text::{bytes_text, grouped, short_number};

#[test]
fn numbers_are_readable() {
    assert_eq!(grouped(1_234_567), "1\u{a0}234\u{a0}567");
    assert_eq!(grouped(12), "12");
    assert_eq!(bytes_text(64.0 * 1024.0 * 1024.0), "64.0 MiB");
    assert_eq!(bytes_text(12.0), "12 B");
    assert_eq!(short_number(0.012_345), "0.0123");
    assert_eq!(short_number(12_345.6), "12\u{a0}346");
    assert_eq!(short_number(-1e6), "-1\u{a0}000\u{a0}000");
    assert_eq!(short_number(999.4), "999");
    assert_eq!(short_number(1.5e9), "1.50e9");
}
