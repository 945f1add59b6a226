//! The channel section.

use crate::bytes::{ByteReader, ByteWriter};
use crate::limits::MAX_CHANNELS;
use crate::{Channel, ChannelKind, ContentError, TexelFormat};

const FLAG_SRGB: u8 = 1;

/// What must hold for a list of channels.
pub(crate) fn check(channels: &[Channel]) -> Result<(), ContentError> {
    if channels.len() > MAX_CHANNELS {
        return Err(ContentError::TooMany {
            what: "channels",
            count: channels.len() as u64,
            limit: MAX_CHANNELS as u64,
        });
    }
    if channels.is_empty() {
        return Err(ContentError::Count { what: "channels", expected: 1, got: 0 });
    }
    match channels.iter().position(|c| c.srgb && c.format.channel_count() < 4) {
        Some(channel) => Err(ContentError::Srgb { channel }),
        None => Ok(()),
    }
}

pub(crate) fn encode(channels: &[Channel]) -> Vec<u8> {
    let mut out = ByteWriter::default();
    out.u32(channels.len() as u32);
    for channel in channels {
        out.u8(code(&ChannelKind::ALL, channel.kind));
        out.u8(code(&TexelFormat::ALL, channel.format));
        out.u8(if channel.srgb { FLAG_SRGB } else { 0 });
        out.u8(0);
    }
    out.bytes
}

pub(crate) fn decode(bytes: &[u8]) -> Result<Vec<Channel>, ContentError> {
    let mut input = ByteReader::new(bytes);
    let count = input.count(MAX_CHANNELS, "channels")?;
    let mut channels = Vec::with_capacity(count);
    for index in 0..count {
        let kind = decoded(&ChannelKind::ALL, input.u8("a channel")?, "kind of channel", index)?;
        let format = decoded(&TexelFormat::ALL, input.u8("a channel")?, "format of channel", index)?;
        let flags = decoded(&[0, FLAG_SRGB], input.u8("a channel")?, "flags of channel", index)?;
        decoded(&[0], input.u8("a channel")?, "reserved byte of channel", index)?;
        channels.push(Channel { kind, format, srgb: flags == FLAG_SRGB });
    }
    input.end()?;
    check(&channels)?;
    Ok(channels)
}

fn code<T: PartialEq>(all: &[T], item: T) -> u8 {
    all.iter().position(|x| *x == item).unwrap_or(0) as u8
}

fn decoded<T: Copy>(all: &[T], code: u8, what: &'static str, index: usize) -> Result<T, ContentError> {
    all.get(usize::from(code)).copied().ok_or(ContentError::OutOfRange {
        what,
        index,
        value: u64::from(code),
        limit: all.len() as u64,
    })
}
