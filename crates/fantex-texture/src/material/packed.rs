//! Images of models.

use fantex_base::{Error, Result};
use fantex_mesh::{ImageChannel, ImageSource, PackedImage};

use super::bump;
use crate::{AlphaUse, ColorSpace, Depth, Image, Samples};

/// Decodes an image of a model. Its numbers are taken for `space`, whatever the file claims (glTF 2.0, section 3.8), except for floats; of
/// packed images, alpha comes from numbers as they are; of bump maps that are grey, the normals that their heights make.
///
/// # Errors
/// A file cannot be read or decoded, or the images of a packed one differ too much in shape.
pub fn read_image(source: &ImageSource, space: ColorSpace) -> Result<Image> {
    let mut image = match source {
        ImageSource::File(path) => Image::load_as(path, space)?,
        ImageSource::Embedded { label, bytes } => Image::decode(bytes, label, space)?,
        ImageSource::Packed(packed) => return pack(packed, space),
        ImageSource::Bump(bump) => return bump::read(bump, space),
    };
    if !matches!(image.samples, Samples::F32(_)) {
        image.space = space;
    }
    Ok(image)
}

/// How many times the texels of the largest source an image put together may have.
const MAX_GROWTH: u64 = 4;

fn pack(packed: &PackedImage, space: ColorSpace) -> Result<Image> {
    let mut read: Vec<(&ImageSource, ColorSpace, Image)> = Vec::new();
    let mut channels: [Option<(usize, ImageChannel)>; 4] = [None; 4];
    for (index, channel) in packed.channels.iter().enumerate() {
        let Some(channel) = channel else { continue };
        let space = if index == 3 { ColorSpace::Linear } else { space };
        let known =
            read.iter().position(|(source, as_space, _)| (*source, *as_space) == (&channel.source, space));
        let image = match known {
            Some(image) => image,
            None => {
                read.push((&channel.source, space, read_image(&channel.source, space)?));
                read.len() - 1
            }
        };
        channels[index] = Some((image, channel.channel));
    }
    let images = || read.iter().map(|(.., image)| image);
    let width = images().map(|image| image.width).max().unwrap_or(1);
    let height = images().map(|image| image.height).max().unwrap_or(1);
    // Of two stripes that cross, a large square would become.
    let largest = images().map(|image| u64::from(image.width) * u64::from(image.height)).max().unwrap_or(1);
    if u64::from(width) * u64::from(height) > MAX_GROWTH * largest {
        return Err(Error::too_large(format!(
            "its channels come from images of too different shapes, which together need {width} x {height} texels; give them one shape"
        )));
    }
    let depths: Vec<Depth> = images().map(|image| image.samples.depth()).collect();
    let depth =
        [Depth::F32, Depth::U16].into_iter().find(|depth| depths.contains(depth)).unwrap_or(Depth::U8);
    let images: Vec<Image> =
        read.into_iter().map(|(.., image)| image.resized(width, height, AlphaUse::Independent)).collect();
    let channels =
        channels.map(|channel| channel.map(|(image, channel)| (image, resolved(channel, &images[image]))));
    let count = if channels[3].is_some() { 4 } else { 3 };
    let mut samples = match depth {
        Depth::U8 => Samples::U8(Vec::new()),
        Depth::U16 => Samples::U16(Vec::new()),
        Depth::F32 => Samples::F32(Vec::new()),
    };
    // By rows, so that few texels are floats at once.
    for y in 0..height {
        let texel = |x: u32| {
            channels.map(|channel| {
                channel.map_or(1.0, |(image, channel)| number(images[image].linear_texel(x, y), channel))
            })
        };
        let row = (0..width).flat_map(|x| texel(x).into_iter().take(count)).collect();
        let row = Image::from_linear(width, 1, count as u8, row).converted(depth, space);
        match (&mut samples, row.samples) {
            (Samples::U8(all), Samples::U8(row)) => all.extend(row),
            (Samples::U16(all), Samples::U16(row)) => all.extend(row),
            (Samples::F32(all), Samples::F32(row)) => all.extend(row),
            _ => {}
        }
    }
    Ok(Image { width, height, channels: count as u8, space, samples })
}

/// What stands for the opacity of an image: alpha, unless it says nothing.
fn resolved(channel: ImageChannel, image: &Image) -> ImageChannel {
    if channel != ImageChannel::Opacity {
        return channel;
    }
    let is_clear = |(x, y)| image.linear_texel(x, y)[3] < 1.0;
    let mut places = (0..image.height).flat_map(|y| (0..image.width).map(move |x| (x, y)));
    if image.has_alpha() && places.any(is_clear) { ImageChannel::Alpha } else { ImageChannel::Luminance }
}

fn number([r, g, b, a]: [f32; 4], channel: ImageChannel) -> f32 {
    match channel {
        ImageChannel::Red => r,
        ImageChannel::Green => g,
        ImageChannel::Blue => b,
        ImageChannel::Alpha => a,
        ImageChannel::Luminance | ImageChannel::Opacity => 0.2126 * r + 0.7152 * g + 0.0722 * b,
    }
}
