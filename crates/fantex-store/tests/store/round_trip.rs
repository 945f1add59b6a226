//! What is written is what is read, on any number of threads, in any batches; and writing fails cleanly.

use std::path::Path;

use crate::common::{
    block_channels, encoded_page, fan_cover, means, page_texels, pages, plain_channels, sheet, tetrahedron,
    write,
};
use fantex_mesh::{Material, Mesh, ToonInterpolation, ToonScale};
use fantex_store::{
    Asset, AssetWriter, Channel, CreateError, CreateOptions, PageId, Quality, TexelSlice, decode, encode,
};
use glam::Vec3;

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
    assert!(matches!(create().finish(&means(&cover, &channels)), Err(CreateError::Incomplete { .. })));
    assert!(folder_is_empty(folder.path()));
}

#[test]
fn pages_out_of_turn_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    let (mesh, cover, channels) = small();
    let ids: Vec<PageId> = pages(&cover).collect();
    let page = |i: usize| encoded_page(&cover, &channels, ids[i]);
    let mut writer = AssetWriter::create(&path, &CreateOptions::default(), &mesh, &cover, &channels).unwrap();
    assert!(matches!(writer.write_pages(vec![page(1)]), Err(CreateError::Order { .. })));
    let mut short = page(0);
    short.channels[2].pop();
    assert!(matches!(writer.write_pages(vec![short]), Err(CreateError::PageBytes { .. })));
    writer.write_pages((0..ids.len()).map(page).collect()).unwrap();
    assert!(matches!(writer.write_pages(vec![page(0)]), Err(CreateError::NoSuchPage { .. })));
    assert!(matches!(writer.finish(&[]), Err(CreateError::Means { .. })));
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
    assert!(matches!(create(false), Err(CreateError::Exists(_))));
    late.write_pages(pages(&cover).map(|id| encoded_page(&cover, &channels, id)).collect()).unwrap();
    assert!(matches!(late.finish(&means(&cover, &channels)), Err(CreateError::Exists(_))));
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
    let changes: [Change; 18] = [
        |_, cover, _| cover.delta = 0.5,
        |_, cover, _| cover.delta = f32::NAN,
        |_, cover, _| cover.density = 0.0,
        |_, cover, _| cover.groups[1].extent = [10, 8],
        |_, cover, _| cover.groups[1].extent = [0, 8],
        |_, cover, _| cover.groups[1].extent = [1 << 17, 8],
        |_, cover, _| cover.groups[0].uv_scale.x = f32::INFINITY,
        |_, cover, _| cover.corner_groups[0][1] = 4,
        |_, cover, _| _ = cover.unfolded.pop(),
        |_, cover, _| cover.unfolded.swap(0, 1),
        |mesh, _, _| mesh.triangles[2][0] = 77,
        |mesh, _, _| mesh.triangles[2][0] = mesh.triangles[2][1],
        |mesh, _, _| mesh.positions[0].x = f32::NAN,
        |_, _, channels| channels.clear(),
        |mesh, _, _| mesh.materials = vec![toon_shaded(&[])],
        |mesh, _, _| mesh.materials = vec![toon_shaded(&[0.0; ToonScale::MOST_STOPS + 1])],
        |mesh, _, _| mesh.materials = vec![toon_shaded(&[0.2, 0.1])],
        |mesh, _, _| mesh.materials = vec![toon_shaded(&[f32::NAN])],
    ];
    for (i, change) in changes.into_iter().enumerate() {
        let (mut mesh, mut cover, mut channels) = (mesh.clone(), cover.clone(), channels.clone());
        change(&mut mesh, &mut cover, &mut channels);
        let result = AssetWriter::create(&path, &CreateOptions::default(), &mesh, &cover, &channels);
        assert!(matches!(result, Err(CreateError::Content { .. })), "change {i}");
    }
    assert!(folder_is_empty(folder.path()));
}
