//! What the texture function needs to know of the groups, as shaders read it.

use fantex_cover::Cover;
use fantex_store::{Channel, ChannelKind};
use half::f16;

use crate::PageTable;

/// Per group the number of its first page; quarters of its columns and (`<< 16`) rows at level 0.
pub fn group_records(cover: &Cover, pages: &PageTable) -> Vec<[u32; 2]> {
    let groups = cover.groups.iter().zip(0..);
    let records = groups.map(|(group, index)| {
        let [columns, rows] = group.extent.map(|n| n / 4);
        [pages.first(index), columns | rows << 16]
    });
    records.collect()
}

/// Per group and channel its mean, linear RGBA, as far as half floats go. `mean` gives that of a channel and group.
pub fn mean_records(groups: usize, channels: usize, mean: impl Fn(usize, u32) -> [f32; 4]) -> Vec<[f16; 4]> {
    let limit = f32::from(f16::MAX);
    let of_group = |group| {
        let mean = &mean;
        let half = move |x: f32| f16::from_f32(x.clamp(-limit, limit));
        (0..channels).map(move |channel| mean(channel, group).map(half))
    };
    (0..groups as u32).flat_map(of_group).collect()
}

/// Per group the projection direction and the x axis. They turn normals and directions; without channels of those there are none.
pub fn frame_records(cover: &Cover, channels: &[Channel]) -> Vec<[f32; 6]> {
    let is_turned = |kind| matches!(kind, ChannelKind::Normal | ChannelKind::Anisotropy);
    let has_vectors = channels.iter().any(|channel| is_turned(channel.kind));
    let frames = cover.groups.iter().filter(|_| has_vectors).map(|group| {
        let (d, x) = (group.frame.direction, group.frame.x_axis);
        [d.x, d.y, d.z, x.x, x.y, x.z]
    });
    frames.collect()
}
