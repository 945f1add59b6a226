//! Pictures that were looked at and found right, in `tests/goldens`.

use std::path::{Path, PathBuf};

use fantex_render::Picture;
use fantex_texture::Image;

/// Largest difference of an 8-bit sRGB value from its golden. Visibility and coverage are decided in integers and do
/// not vary; colours go through powers, sines and square roots whose last bits differ between platforms, which can turn
/// a rounding by one step, and by two where two such values meet in a pixel.
const TOLERANCE: u8 = 2;

/// Compares a picture with its golden. `FANTEX_BLESS=1` writes goldens instead; a missing one fails.
pub(crate) fn check(name: &str, picture: &Picture) {
    let path = folder().join(format!("{name}.png"));
    let seen = picture.to_srgb_image();
    if std::env::var_os("FANTEX_BLESS").is_some_and(|v| v == "1") {
        seen.save(&path).unwrap();
        return;
    }
    let golden = Image::load(&path).unwrap_or_else(|e| panic!("no golden (FANTEX_BLESS=1 writes it): {e}"));
    let difference = largest_difference(&golden, &seen);
    if difference.is_none_or(|d| d > TOLERANCE) {
        let actual = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.png"));
        seen.save(&actual).unwrap();
        panic!(
            "{name} differs from its golden by {difference:?} of 255 (allowed {TOLERANCE}); see {}",
            actual.display()
        );
    }
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/goldens")
}

/// In steps of 8-bit values; `None` for pictures of different shape.
fn largest_difference(a: &Image, b: &Image) -> Option<u8> {
    use fantex_texture::Samples::U8;
    let (U8(x), U8(y)) = (&a.samples, &b.samples) else {
        return None;
    };
    let same_shape = (a.width, a.height, a.channels) == (b.width, b.height, b.channels);
    same_shape.then(|| x.iter().zip(y).map(|(x, y)| x.abs_diff(*y)).max().unwrap_or(0))
}
