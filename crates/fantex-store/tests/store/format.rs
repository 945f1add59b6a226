//! Reads assets by nothing but `docs/format.md`, so that the page and the code cannot drift apart.

use crate::common::{block_channels, fan_cover, means, pages, plain_channels, sheet, write};
use fantex_store::Asset;

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

/// Unpacks the section of the record at `at` in slot A.
fn section(file: &[u8], at: usize) -> Vec<u8> {
    let (offset, stored) = (u64_at(file, at) as usize, u64_at(file, at + 8) as usize);
    let raw = zstd::decode_all(&file[offset..offset + stored]).unwrap();
    assert_eq!(raw.len() as u64, u64_at(file, at + 16));
    raw
}

/// An array of words as the page describes it.
fn array(bytes: &[u8], n: usize, lanes: usize) -> Vec<u32> {
    let mut words = vec![0u32; n * lanes];
    for i in 0..n {
        for lane in 0..lanes {
            let z: u32 = (0..4).map(|k| u32::from(bytes[k * n * lanes + i * lanes + lane]) << (8 * k)).sum();
            let d = if z & 1 == 0 { z / 2 } else { !(z / 2) };
            let before = if i == 0 { 0 } else { words[(i - 1) * lanes + lane] };
            words[i * lanes + lane] = before.wrapping_add(d);
        }
    }
    words
}

/// Side of a tile at a level.
fn side(n: u32, level: u32) -> u32 {
    4 * ((n + 2 * (1 << level)) / (4 * (1 << level))).max(1)
}

/// Extents of a level's pages, in order; none beyond the last level.
fn page_extents([w, h]: [u32; 2], level: u32) -> Vec<[u32; 2]> {
    if level > 0 && side(w.max(h), level - 1) == 4 {
        return Vec::new();
    }
    let [w, h] = [side(w, level), side(h, level)];
    let columns = |y: u32| (0..w).step_by(256).map(move |x| [(w - x).min(256), (h - y).min(256)]);
    (0..h).step_by(256).flat_map(columns).collect()
}

const BLOCK_BYTES: [usize; 8] = [8, 8, 16, 16, 16, 32, 64, 256];
const RECORDS: [&str; 8] =
    ["D2 D2 P4", "D1 D1 P6", "D1 D1 P6 D1 D1 P6", "E P8", "D1", "D1 D1", "D1 D1 D1 D1", "D4 D4 D4 D4"];

/// The records of a stream.
fn records(format: usize, stream: &[u8]) -> Vec<u8> {
    let length = |field: &str| match field {
        "E" => 8,
        _ => field[1..].parse::<usize>().unwrap(),
    };
    let fields: Vec<&str> = RECORDS[format].split(' ').collect();
    let record: usize = fields.iter().map(|field| length(field)).sum();
    let n = stream.len() / record;
    let mut out = vec![0; stream.len()];
    let mut at = 0;
    for field in fields {
        let bytes = length(field);
        let values = &stream[at * n..(at + bytes) * n];
        let mut before = 0u64;
        let mut points = [0u8; 8];
        for i in 0..n {
            let value: Vec<u8> = match (field, bytes) {
                ("E", _) => {
                    let e: Vec<u8> = (0..8).map(|k| values[k * n + i]).collect();
                    let green = |k: usize| if [0, 1, 4, 5].contains(&k) { e[2 + k % 2] } else { 0 };
                    for k in 0..8 {
                        points[k] = points[k].wrapping_add(e[k]).wrapping_add(green(k));
                    }
                    let low: u64 =
                        (0..8).map(|k| u64::from(points[k] & 127) << (7 + 7 * k)).fold(0, |a, b| a | b);
                    let t: u64 = (0..8).map(|k| u64::from(points[k] >> 7) << k).sum();
                    (low | (t & 127) | ((t >> 7) << 63)).to_le_bytes().to_vec()
                }
                (_, 1) => {
                    before = (before + u64::from(values[i])) % 256;
                    vec![before as u8]
                }
                (field, _) if field.starts_with('D') => {
                    let z: u64 = (0..bytes).map(|k| u64::from(values[k * n + i]) << (8 * k)).sum();
                    let d = if z & 1 == 0 { z / 2 } else { !(z / 2) };
                    before = before.wrapping_add(d) & ((1 << (8 * bytes)) - 1);
                    before.to_le_bytes()[..bytes].to_vec()
                }
                _ => values[i * bytes..(i + 1) * bytes].to_vec(),
            };
            out[i * record + at..][..bytes].copy_from_slice(&value);
        }
        at += bytes;
    }
    out
}

#[test]
fn the_page_describes_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    let mesh = sheet(3);
    let cover = fan_cover(&mesh, |v| [[64, 48], [4, 4], [600, 260], [8, 20], [256, 256], [12, 516]][v % 6]);
    for channels in [block_channels(), plain_channels()] {
        write(&path, &mesh, &cover, &channels, 7).unwrap();
        let file = std::fs::read(&path).unwrap();
        assert_eq!(&file[..8], b"\x89FAN\r\n\x1a\n");
        assert_eq!((u32_at(&file, 8), u64_at(&file, 24)), (1, file.len() as u64));

        let formats: Vec<usize> =
            section(&file, 32)[4..].chunks(4).map(|channel| usize::from(channel[1])).collect();
        let block: usize = formats.iter().map(|&f| BLOCK_BYTES[f]).sum();

        let raw = section(&file, 64);
        let (t, g) = (u32_at(&raw, 8) as usize, u32_at(&raw, 12) as usize);
        assert_eq!(array(&raw[20..], t, 3), cover.corner_groups.as_flattened());
        let extents = array(&raw[20 + 12 * t + g..], g, 2);
        let maps = array(&raw[20 + 12 * t + 9 * g..], g, 13);
        assert_eq!(f32::from_bits(maps[13 + 9]), cover.groups[1].uv_scale.x);

        let raw = section(&file, 96);
        let v = u32_at(&raw, 0) as usize;
        assert_eq!(array(&raw[52..], t, 3), mesh.triangles.as_flattened());
        let positions = array(&raw[52 + 12 * t..], v, 3);
        assert_eq!(f32::from_bits(positions[3 * 5 + 1]), mesh.positions[5].y);

        let directory = section(&file, 128);
        let levels = u32_at(&directory, 0) as usize;
        let counts: Vec<usize> = (0..levels).map(|l| u32_at(&directory, 8 + 4 * l) as usize).collect();
        let mut entry = 8 + 4 * levels;
        let asset = Asset::open(&path).unwrap();
        let mut written = pages(&cover).collect::<Vec<_>>();
        written.sort_by_key(|id| (id.level, id.group, id.page[1], id.page[0]));
        let mut due = written.into_iter();
        for (level, &count) in counts.iter().enumerate() {
            let all: Vec<(usize, usize, [u32; 2])> = (0..g)
                .flat_map(|group| {
                    let extent = [extents[2 * group], extents[2 * group + 1]];
                    page_extents(extent, level as u32)
                        .into_iter()
                        .enumerate()
                        .map(move |(k, e)| (group, k, e))
                })
                .collect();
            let start = |i: usize| {
                let place = (
                    u32_at(&directory, entry + 32 * i) as usize,
                    u32_at(&directory, entry + 32 * i + 4) as usize,
                );
                all.iter().position(|&(group, page, _)| (group, page) == place).unwrap()
            };
            for i in 0..count {
                let run = &all[start(i)..if i + 1 < count { start(i + 1) } else { all.len() }];
                let at = entry + 32 * i;
                let (offset, stored) =
                    (u64_at(&directory, at + 8) as usize, u32_at(&directory, at + 16) as usize);
                let raw = zstd::decode_all(&file[offset..offset + stored]).unwrap();
                let blocks = |e: [u32; 2]| (e[0] / 4 * (e[1] / 4)) as usize;
                let b: usize = run.iter().map(|&(_, _, e)| blocks(e)).sum();
                assert_eq!(raw.len(), b * block);
                let mut from = 0;
                let streams: Vec<Vec<u8>> = formats
                    .iter()
                    .map(|&f| {
                        from += b * BLOCK_BYTES[f];
                        records(f, &raw[from - b * BLOCK_BYTES[f]..from])
                    })
                    .collect();
                let mut before = 0;
                for &(group, _, extent) in run {
                    let id = due.next().unwrap();
                    assert_eq!((id.level as usize, id.group as usize), (level, group));
                    for (channel, stream) in streams.iter().enumerate() {
                        let bytes = BLOCK_BYTES[formats[channel]];
                        let page = &stream[before * bytes..(before + blocks(extent)) * bytes];
                        assert!(asset.read_page_raw(channel, id).unwrap() == page, "{id}, channel {channel}");
                    }
                    before += blocks(extent);
                }
            }
            entry += 32 * count;
        }
        assert!(due.next().is_none());
        let mean_bytes: usize = formats.iter().map(|&f| if f == 7 { 16 } else { 8 }).sum();
        assert_eq!(directory.len(), entry + g * mean_bytes);
        let red =
            half::f16::from_le_bytes([directory[entry + mean_bytes], directory[entry + mean_bytes + 1]]);
        assert_eq!(red.to_f32(), means(&cover, &channels)[channels.len()][0]);
    }
}
