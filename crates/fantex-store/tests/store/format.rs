//! The file as `docs/format.md` describes it, what is written comes back, and other sources than files.

use std::io;
use std::path::Path;
use std::sync::{Arc, Mutex};

use fantex_base::{ErrorKind, Random, ReadLimits, ReadOptions};
use fantex_cover::{Cover, CoverOptions, GroupKind, TexelBudget, UnfoldedCorners, build_cover};
use fantex_mesh::{CleanOptions, Material, Mesh, ToonInterpolation, ToonScale, clean, generate};
use fantex_store::{
    Asset, AssetEditor, AssetWriter, ByteSource, Channel, CreateOptions, EditOptions, PageId, Quality,
    TexelSlice, decode, encode,
};
use fantex_test::fan_file::{seal, set_word};
use glam::{Vec3, Vec4};

use crate::common::{
    block_channels, encoded_page, fan_cover, means, page_texels, pages, plain_channels, sheet, tetrahedron,
    write,
};

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

/// Extents that need one page, several, and long thin ones.
fn mixed_extent(v: usize) -> [u32; 2] {
    [[64, 48], [4, 4], [600, 260], [8, 20], [256, 256], [12, 516]][v % 6]
}

fn check_pages(asset: &Asset, channels: &[Channel]) {
    for id in pages(asset.cover()) {
        for (index, channel) in channels.iter().enumerate() {
            let (extent, texels) = page_texels(asset.cover(), id, index);
            let bytes = encode(channel.format, Quality::UltraFast, extent, TexelSlice::F32(&texels)).unwrap();
            assert!(asset.read_page_raw(index, id).unwrap() == bytes, "{id}");
            let page = asset.read_page(index, id).unwrap();
            assert_eq!(page.extent, extent);
            let stored = decode(channel.format, extent, &bytes).unwrap();
            for (linear, stored) in page.rgba.iter().zip(&stored) {
                if channel.srgb {
                    assert!(linear[3] == stored[3] && linear[0] <= stored[0]);
                } else {
                    assert_eq!(linear, stored);
                }
            }
        }
    }
}

#[test]
fn everything_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    for channels in [block_channels(), plain_channels()] {
        let path = folder.path().join("sheet.fan");
        let mesh = sheet(3);
        let cover = fan_cover(&mesh, mixed_extent);
        let summary = write(&path, &mesh, &cover, &channels, 7).unwrap();
        assert_eq!(summary.bytes, std::fs::metadata(&path).unwrap().len());
        assert_eq!(summary.pages, pages(&cover).count() as u64);

        let asset = Asset::open(&path).unwrap();
        assert_eq!(asset.mesh(), &mesh);
        assert_eq!(asset.cover(), &cover);
        assert_eq!(asset.channels(), channels);
        assert_eq!(asset.file_bytes(), summary.bytes);
        for (i, mean) in means(&cover, &channels).into_iter().enumerate() {
            let (group, channel) = (i / channels.len(), i % channels.len());
            assert_eq!(asset.mean(channel, group as u32), mean);
        }
        check_pages(&asset, &channels);
    }
}

#[test]
fn colors_of_corners_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let [plain, colored] = ["plain.fan", "colored.fan"].map(|name| folder.path().join(name));
    let mut mesh = sheet(3);
    let cover = fan_cover(&mesh, |_| [16, 16]);
    write(&plain, &mesh, &cover, &block_channels(), 1).unwrap();
    mesh.corners.colors = vec![Vec4::new(0.25, 0.5, 0.75, 1.0); 3 * mesh.triangles.len()];
    write(&colored, &mesh, &cover, &block_channels(), 1).unwrap();
    assert!(std::fs::read(&plain).unwrap() == std::fs::read(&colored).unwrap());
}

#[test]
fn a_mesh_without_attributes_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tetrahedron.fan");
    let mesh = tetrahedron();
    let cover = fan_cover(&mesh, |_| [16, 16]);
    write(&path, &mesh, &cover, &block_channels(), 1).unwrap();
    let asset = Asset::open(&path).unwrap();
    assert_eq!(asset.mesh(), &mesh);
    assert_eq!(asset.level_count(), 3);
    check_pages(&asset, &block_channels());
}

#[test]
fn pages_that_do_not_exist_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tetrahedron.fan");
    let mesh = tetrahedron();
    let cover = fan_cover(&mesh, |_| [16, 16]);
    write(&path, &mesh, &cover, &block_channels(), 100).unwrap();
    let asset = Asset::open(&path).unwrap();
    for (channel, group, level, page) in [
        (4, 0, 0, [0, 0]),
        (0, 4, 0, [0, 0]),
        (0, u32::MAX, 0, [0, 0]),
        (0, 0, 3, [0, 0]),
        (0, 0, u32::MAX, [0, 0]),
        (0, 0, 0, [1, 0]),
        (0, 0, 0, [0, u32::MAX]),
    ] {
        assert!(asset.read_page(channel, PageId { group, level, page }).is_err());
        assert!(asset.read_page_raw(channel, PageId { group, level, page }).is_err());
    }
}

#[test]
fn bytes_do_not_depend_on_threads_or_batches() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = sheet(8);
    let cover = fan_cover(&mesh, mixed_extent);
    let mut files = Vec::new();
    for (threads, batch) in [(1, 1000), (2, 5), (4, 64)] {
        let path = folder.path().join(format!("{threads}.fan"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| write(&path, &mesh, &cover, &block_channels(), batch)).unwrap();
        files.push(std::fs::read(&path).unwrap());
    }
    assert!(files[0] == files[1] && files[0] == files[2]);
}

fn folder_is_empty(folder: &Path) -> bool {
    std::fs::read_dir(folder).unwrap().next().is_none()
}

fn small() -> (Mesh, fantex_cover::Cover, Vec<Channel>) {
    let mesh = tetrahedron();
    let cover = fan_cover(&mesh, |_| [8, 8]);
    (mesh, cover, block_channels())
}

#[test]
fn an_unfinished_writer_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    let (mesh, cover, channels) = small();
    let create = || AssetWriter::create(&path, &CreateOptions::default(), &mesh, &cover, &channels).unwrap();
    drop(create());
    assert!(folder_is_empty(folder.path()));
    refused(create().finish(&means(&cover, &channels)), "has not been written");
    assert!(folder_is_empty(folder.path()));
}

fn refused<T: std::fmt::Debug>(result: fantex_base::Result<T>, sentence: &str) {
    let error = result.unwrap_err().to_string();
    assert!(error.contains(sentence), "{error}");
}

#[test]
fn pages_out_of_turn_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    let (mesh, cover, channels) = small();
    let ids: Vec<PageId> = pages(&cover).collect();
    let page = |i: usize| encoded_page(&cover, &channels, ids[i]);
    let mut writer = AssetWriter::create(&path, &CreateOptions::default(), &mesh, &cover, &channels).unwrap();
    refused(writer.write_pages(vec![page(1)]), "came where");
    let mut short = page(0);
    short.channels[2].pop();
    refused(writer.write_pages(vec![short]), "bytes per channel");
    writer.write_pages((0..ids.len()).map(page).collect()).unwrap();
    refused(writer.write_pages(vec![page(0)]), "is not part of the cover");
    refused(writer.finish(&[]), "means are due");
    assert!(folder_is_empty(folder.path()));
}

#[test]
fn nothing_is_overwritten_without_force() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    let (mesh, cover, channels) = small();
    let create = |force| {
        let options = CreateOptions { force, ..CreateOptions::default() };
        AssetWriter::create(&path, &options, &mesh, &cover, &channels)
    };
    // A file that appears while the asset is being written survives, too.
    let mut late = create(false).unwrap();
    std::fs::write(&path, "precious").unwrap();
    refused(create(false), "exists already");
    late.write_pages(pages(&cover).map(|id| encoded_page(&cover, &channels, id)).collect()).unwrap();
    refused(late.finish(&means(&cover, &channels)), "exists already");
    assert_eq!(std::fs::read(&path).unwrap(), b"precious");
    write(&path, &mesh, &cover, &channels, 10).unwrap();
    assert!(Asset::open(&path).is_ok());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn an_unwritable_folder_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("missing").join("a.fan");
    let (mesh, cover, channels) = small();
    let error = AssetWriter::create(&path, &CreateOptions::default(), &mesh, &cover, &channels).unwrap_err();
    assert!(error.to_string().starts_with(&format!("cannot write {}", path.display())), "{error}");
}

fn toon_shaded(places: &[f32]) -> Material {
    let stops = places.iter().map(|&at| (at, Vec3::ONE)).collect();
    let scale = ToonScale { stops, interpolation: ToonInterpolation::Linear };
    Material { toon: Some(scale), ..Material::default() }
}

#[test]
fn contents_against_the_rules_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    let (mesh, cover, channels) = small();
    type Change = fn(&mut Mesh, &mut fantex_cover::Cover, &mut Vec<Channel>);
    let changes: [Change; 21] = [
        |_, cover, _| cover.delta = 0.5,
        |_, cover, _| cover.delta = f32::NAN,
        |_, cover, _| cover.density = 0.0,
        |_, cover, _| cover.groups[1].extent = [10, 8],
        |_, cover, _| cover.groups[1].extent = [0, 8],
        |_, cover, _| cover.groups[1].extent = [1 << 17, 8],
        |_, cover, _| cover.groups[0].uv_scale.x = f32::INFINITY,
        |_, cover, _| cover.corner_groups[0][1] = 4,
        |_, cover, _| cover.unfolded = cover.unfolded.iter().copied().skip(1).collect(),
        |_, cover, _| cover.unfolded = cover.unfolded.iter().copied().rev().collect(),
        |mesh, _, _| mesh.triangles[2][0] = 77,
        |mesh, _, _| mesh.triangles[2][0] = mesh.triangles[2][1],
        |mesh, _, _| mesh.positions[0].x = f32::NAN,
        |mesh, _, _| mesh.world_from_mesh.scale = 0.0,
        |mesh, _, _| mesh.world_from_mesh.scale = -2.0,
        |mesh, _, _| mesh.world_from_mesh.offset.y = f64::NAN,
        |_, _, channels| channels.clear(),
        |mesh, _, _| mesh.materials = vec![toon_shaded(&[])],
        |mesh, _, _| mesh.materials = vec![toon_shaded(&[0.0; ToonScale::MAX_STOPS + 1])],
        |mesh, _, _| mesh.materials = vec![toon_shaded(&[0.2, 0.1])],
        |mesh, _, _| mesh.materials = vec![toon_shaded(&[f32::NAN])],
    ];
    for (i, change) in changes.into_iter().enumerate() {
        let (mut mesh, mut cover, mut channels) = (mesh.clone(), cover.clone(), channels.clone());
        change(&mut mesh, &mut cover, &mut channels);
        let result = AssetWriter::create(&path, &CreateOptions::default(), &mesh, &cover, &channels);
        let error = result.unwrap_err();
        assert!(matches!(error.kind(), ErrorKind::Malformed | ErrorKind::TooLarge), "change {i}: {error}");
    }
    assert!(folder_is_empty(folder.path()));
}

/// A triangle with several corners in a group that is unrolled over creases lies in one place of its tile.
#[test]
fn unrolled_corners_must_agree() {
    let mut crumpled = generate::icosphere(2);
    let mut random = Random::new(3);
    crumpled.positions.iter_mut().for_each(|p| *p *= 0.7 + 0.6 * random.unit());
    let (mesh, _) = clean(crumpled, &CleanOptions::default()).unwrap();
    let options = CoverOptions { budget: TexelBudget::Total(1 << 16), ..CoverOptions::default() };
    let (mut cover, _) = build_cover(&mesh, &options).unwrap();
    let groups = |cover: &Cover, i: usize| {
        let corner = cover.unfolded[i].corner as usize;
        (corner / 3, cover.corner_groups[corner / 3][corner % 3])
    };
    let twin = (1..cover.unfolded.len()).find(|&i| groups(&cover, i) == groups(&cover, i - 1)).unwrap();
    assert_eq!(cover.unfolded[twin].uv, cover.unfolded[twin - 1].uv);
    let mut entries = cover.unfolded.to_vec();
    entries[twin].uv[1].x += 0.01;
    cover.unfolded = entries.into();
    let path = tempfile::tempdir().unwrap().path().join("a.fan");
    let result = AssetWriter::create(&path, &CreateOptions::default(), &mesh, &cover, &plain_channels());
    let error = result.unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Malformed);
    assert!(error.to_string().contains("in one unfolded group"), "{error}");
}

/// Bytes in memory that remember what was asked for.
#[derive(Debug, Default)]
struct Recorded {
    bytes: Mutex<Vec<u8>>,
    reads: Mutex<Vec<(u64, usize)>>,
}

impl ByteSource for Recorded {
    fn location(&self) -> &Path {
        Path::new("https://example.org/recorded.fan")
    }

    fn length(&self) -> io::Result<u64> {
        Ok(self.bytes.lock().unwrap().len() as u64)
    }

    fn read_at(&self, into: &mut [u8], offset: u64) -> io::Result<usize> {
        self.reads.lock().unwrap().push((offset, into.len()));
        let bytes = self.bytes.lock().unwrap();
        let from = (offset as usize).min(bytes.len());
        let count = into.len().min(bytes.len() - from);
        into[..count].copy_from_slice(&bytes[from..from + count]);
        Ok(count)
    }
}

fn recorded() -> Arc<Recorded> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sheet.fan");
    let mesh = sheet(6);
    let cover = fan_cover(&mesh, |v| [[300, 8], [12, 4], [64, 64], [20, 280]][v % 4]);
    let channels = [block_channels(), plain_channels()].concat();
    write(&path, &mesh, &cover, &channels, 100).unwrap();
    Arc::new(Recorded { bytes: Mutex::new(std::fs::read(&path).unwrap()), ..Recorded::default() })
}

#[test]
fn two_reads_open_an_asset() {
    let source = recorded();
    let asset = Asset::open_source(source.clone()).unwrap();
    let reads = source.reads.lock().unwrap().clone();
    assert_eq!(reads.len(), 2, "{reads:?}");
    assert_eq!(reads[0], (0, 8192));
    assert_eq!(reads[1].0, 8192);
    let first_cluster = asset.clusters().map(|id| asset.cluster_range(id).start).min().unwrap();
    assert!(reads[1].0 + reads[1].1 as u64 <= first_cluster);
}

#[test]
fn clusters_read_by_others_hold_the_same_pages() {
    let source = recorded();
    let asset = Asset::open_source(source.clone()).unwrap();
    let bytes = source.bytes.lock().unwrap().clone();
    let mut seen = 0;
    for cluster in asset.clusters() {
        assert_eq!(asset.cluster_of(asset.first_page_of(cluster)).unwrap(), cluster);
        let range = asset.cluster_range(cluster);
        let stored = &bytes[range.start as usize..range.end as usize];
        let unpacked = asset.unpack_cluster(cluster, stored).unwrap();
        for page in pages(asset.cover()).filter(|&page| asset.cluster_of(page).unwrap() == cluster) {
            for channel in 0..asset.channels().len() {
                let raw = asset.read_page_raw(channel, page).unwrap();
                assert_eq!(asset.page_in(&unpacked, channel, page).unwrap(), raw);
            }
            seen += 1;
        }
        let foreign = pages(asset.cover()).find(|&page| asset.cluster_of(page).unwrap() != cluster).unwrap();
        refused(asset.page_in(&unpacked, 0, foreign), "has no page");
        let mut damaged = stored.to_vec();
        damaged[0] ^= 1;
        let error = asset.unpack_cluster(cluster, &damaged).unwrap_err();
        assert!(error.to_string().contains("https://example.org/recorded.fan"), "{error}");
        assert!(asset.unpack_cluster(cluster, &stored[1..]).is_err());
    }
    assert_eq!(seen, pages(asset.cover()).count());
}

#[test]
fn messages_name_the_location() {
    let source = recorded();
    let length = source.bytes.lock().unwrap().len();
    source.bytes.lock().unwrap().truncate(length - 1);
    let error = Asset::open_source(source).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Damaged);
    assert!(error.to_string().starts_with("https://example.org/recorded.fan is truncated"), "{error}");
}

/// The angle of hard edges lies in the header, where readers of texels need not look. Edits and copies keep it.
#[test]
fn the_angle_of_hard_edges_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    let mesh = sheet(3);
    let plain = fan_cover(&mesh, |_| [16, 16]);
    let cover = Cover { hard_edges: Some(60.0), ..plain.clone() };
    write(&path, &mesh, &plain, &block_channels(), 7).unwrap();
    let without = std::fs::read(&path).unwrap();
    std::fs::remove_file(&path).unwrap();
    write(&path, &mesh, &cover, &block_channels(), 7).unwrap();
    let file = std::fs::read(&path).unwrap();
    for slot in [0, 4096] {
        assert_eq!((u64_at(&without, slot + 192), u64_at(&without, slot + 200)), (0, 0));
        assert_eq!(
            (u32_at(&file, slot + 192), f32::from_bits(u32_at(&file, slot + 196)), u64_at(&file, slot + 200)),
            (1, 60.0, 0)
        );
    }
    // All else is the same.
    assert!(file[256..4096] == without[256..4096] && file[4352..] == without[4352..]);

    let angle = || Asset::open(&path).unwrap().cover().hard_edges;
    assert_eq!(angle(), Some(60.0));
    let mut editor = AssetEditor::open(&path, &EditOptions::default()).unwrap();
    editor.attach("note", vec![1, 2, 3]).unwrap();
    editor.commit().unwrap();
    assert_eq!(angle(), Some(60.0));
    editor.compact().unwrap();
    drop(editor);
    assert_eq!(angle(), Some(60.0));

    for wrong in [-1.0, 181.0, f32::NAN] {
        let mut file = file.clone();
        for slot in [0, 4096] {
            set_word(&mut file, slot + 192, 1 | u64::from(wrong.to_bits()) << 32);
        }
        seal(&mut file);
        std::fs::write(&path, file).unwrap();
        let error = Asset::open(&path).unwrap_err().to_string();
        assert!(error.contains("an angle of 0 to 180 degrees"), "{error}");
    }
}

/// A scan with normals: loading the model takes 64 bytes per triangle and its file, of 25 more, at least.
#[test]
fn what_was_baked_within_a_memory_opens_within_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    let mut mesh = tetrahedron();
    mesh.triangles = mesh.triangles.repeat(5000);
    let mut random = Random::new(7);
    let mut normal = || Vec3::from([0; 3].map(|_| random.unit() as f32 - 0.5)).normalize();
    mesh.corners.normals = (0..3 * mesh.triangles.len()).map(|_| normal()).collect();
    let mut cover = fan_cover(&mesh, |_| [4, 4]);
    cover.groups.iter_mut().for_each(|group| group.kind = GroupKind::Projected);
    cover.unfolded = UnfoldedCorners::default();
    write(&path, &mesh, &cover, &block_channels(), 100).unwrap();
    let open = |bytes_per_triangle: usize| {
        let memory_bytes = (bytes_per_triangle * mesh.triangles.len()) as u64;
        let limits = ReadLimits::new(ReadOptions { memory_bytes, ..ReadOptions::default() });
        limits.run(|| Asset::open(&path))
    };
    assert_eq!(open(89).unwrap().mesh(), &mesh);
    // The mesh itself, and what is stored.
    assert_eq!(open(60).unwrap_err().kind(), ErrorKind::TooLarge);
}
