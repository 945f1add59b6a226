//! OpenEXR files without plain channels R, G and B, which the decoder of pictures does not read: heights, masks and depths of
//! one channel, and the layer of a renderer.

use std::io::Cursor;

use exr::meta::header::Header;
use exr::prelude::{ReadChannels, ReadLayers, read};
use fantex_base::Result;
use image::ImageFormat;

use super::{ImageLimits, not_readable, reserve};
use crate::image::{ColorSpace, Image, Samples};

/// Channels of a file that are named in its error, at most: renderers write dozens.
const MAX_NAMED: usize = 8;

/// The first part of a file whose header was checked; none where the decoder of pictures reads it.
///
/// # Errors
/// The channels are none that stand for a picture, or the data is damaged.
pub(super) fn decode(
    bytes: &[u8],
    headers: &[Header],
    label: &str,
    limits: ImageLimits,
) -> Result<Option<Image>> {
    let is_picture = |header: &Header| !header.deep && matches!(chosen(header), Chosen::Plain);
    let [header, ..] = headers else { return Ok(None) };
    if header.deep || headers.iter().any(is_picture) {
        return Ok(None);
    }
    let refused = |cause: String| not_readable(label, ImageFormat::OpenExr, &cause);
    let channels = match chosen(header) {
        Chosen::These(channels) => channels,
        Chosen::Plain | Chosen::None => {
            let names: Vec<_> = header.channels.list.iter().map(|channel| channel.name.to_string()).collect();
            let named = names[..names.len().min(MAX_NAMED)].join(", ");
            let others = match names.len().saturating_sub(MAX_NAMED) {
                0 => String::new(),
                count => format!(" and {count} more"),
            };
            return Err(refused(format!(
                "its channels are {named}{others}; give it R, G and B (and A), Y (and A), or a single channel"
            )));
        }
    };
    let [window, display] = [header.layer_size, header.shared_attributes.display_window.size];
    let area = (display.0 * display.1) as u64;
    let pixel = (header.channels.bytes_per_pixel + 4 * channels.len()) as u64;
    let _held = reserve(label, area.max((window.0 * window.1) as u64).saturating_mul(pixel), limits)?;
    let file = read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let file = file.all_attributes().from_buffered(Cursor::new(bytes));
    let layer = file.map_err(|error| refused(error.to_string()).with_source(error))?.layer_data;
    // What is stored may be a part of the picture, or more than it.
    let offset = header.own_attributes.layer_position - header.shared_attributes.display_window.position;
    let count = channels.len();
    let mut samples = vec![0.0; area as usize * count];
    for (k, &channel) in channels.iter().enumerate() {
        let stored = &layer.channel_data.list[channel].sample_data;
        for (index, value) in stored.values_as_f32().enumerate() {
            let x = (index % window.0) as i64 + i64::from(offset.0);
            let y = (index / window.0) as i64 + i64::from(offset.1);
            if (0..display.0 as i64).contains(&x) && (0..display.1 as i64).contains(&y) {
                samples[(y as usize * display.0 + x as usize) * count + k] = value;
            }
        }
    }
    if count == 2 {
        samples.as_chunks_mut::<2>().0.iter_mut().filter(|[_, a]| *a > 0.0).for_each(|[y, a]| *y /= *a);
    }
    let (width, height) = (display.0 as u32, display.1 as u32);
    let (channels, space) = (count as u8, ColorSpace::Linear);
    Ok(Some(Image { width, height, channels, space, samples: Samples::F32(samples) }))
}

/// The channels that stand for the picture.
enum Chosen {
    /// R, G and B as they are.
    Plain,
    /// Their places in the list.
    These(Vec<usize>),
    None,
}

fn chosen(header: &Header) -> Chosen {
    let names: Vec<String> = header.channels.list.iter().map(|channel| channel.name.to_string()).collect();
    let place = |name: &str| names.iter().position(|other| other == name);
    if ["R", "G", "B"].iter().all(|name| place(name).is_some()) {
        return Chosen::Plain;
    }
    if header.channels.list.iter().any(|channel| (channel.sampling.0, channel.sampling.1) != (1, 1)) {
        return Chosen::None;
    }
    if let Some(y) = place("Y").filter(|_| place("RY").is_none() && place("BY").is_none()) {
        return Chosen::These([Some(y), place("A")].into_iter().flatten().collect());
    }
    // The channels of a layer have its name before theirs.
    let layers = names.iter().filter_map(|name| name.strip_suffix(".R"));
    let of_layer = |layer: &str| {
        let [r, g, b, a] = ["R", "G", "B", "A"].map(|channel| place(&format!("{layer}.{channel}")));
        Some([Some(r?), Some(g?), Some(b?), a].into_iter().flatten().collect())
    };
    let found: Vec<Vec<usize>> = layers.filter_map(of_layer).collect();
    match (&found[..], names.len()) {
        ([layer], _) => Chosen::These(layer.clone()),
        ([], 1) => Chosen::These(vec![0]),
        _ => Chosen::None,
    }
}
