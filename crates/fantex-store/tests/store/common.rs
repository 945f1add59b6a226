//! Small meshes, covers and assets made by hand.

use std::path::Path;

use fantex_base::Random;
use fantex_cover::{Cover, Frame, Group, GroupKind, UnfoldedCorner};
use fantex_mesh::{
    AlphaMode, CornerAttributes, Material, Mesh, Parts, ToonInterpolation, ToonScale, WorldFromMesh,
};
use fantex_store::{
    AssetWriter, Channel, ChannelKind, CreateOptions, EncodedPage, PageId, Quality, TexelFormat, TexelSlice,
    WriteSummary, encode, group_pages, page_extent, page_origin,
};
use glam::{DVec3, Vec2, Vec3, Vec4};

/// Repeatable random numbers.
pub(crate) struct Dice(Random);

impl Dice {
    pub(crate) fn new(seed: u64) -> Self {
        Self(Random::new(seed))
    }

    pub(crate) fn below(&mut self, n: usize) -> usize {
        self.0.below(n as u64) as usize
    }
}

/// A bumpy sheet of `n * n` squares, two triangles each, with all attributes.
pub(crate) fn sheet(n: u32) -> Mesh {
    let positions: Vec<Vec3> = (0..(n + 1) * (n + 1))
        .map(|i| {
            let (x, y) = ((i % (n + 1)) as f32 / n as f32, (i / (n + 1)) as f32 / n as f32);
            Vec3::new(2.0 * x - 1.0, 2.0 * y - 1.0, 0.1 * (5.0 * x + 3.0 * y).sin())
        })
        .collect();
    let mut triangles = Vec::new();
    for y in 0..n {
        for x in 0..n {
            let a = y * (n + 1) + x;
            let [b, c, d] = [a + 1, a + n + 1, a + n + 2];
            triangles.extend([[a, b, d], [a, d, c]]);
        }
    }
    let corners: Vec<Vec3> = triangles.iter().flatten().map(|&v| positions[v as usize]).collect();
    Mesh {
        corners: CornerAttributes {
            normals: corners.iter().map(|_| Vec3::Z).collect(),
            uv_sets: vec![corners.iter().map(|p| p.truncate()).collect()],
            colors: Vec::new(),
            tangents: corners.iter().map(|_| Vec4::X).collect(),
        },
        triangle_materials: (0..triangles.len() as u32).map(|t| t % 2).collect(),
        parts: Parts {
            names: vec!["Krone".into(), String::new(), "Fuß".into()],
            of_triangle: (0..triangles.len() as u32).map(|t| t % 3).collect(),
        },
        materials: vec![
            Material {
                name: "Blätter".into(),
                alpha: AlphaMode::Mask(0.3),
                unlit: true,
                ..Material::default()
            },
            Material {
                double_sided: false,
                metallic: 0.25,
                toon: Some(ToonScale {
                    stops: vec![(-0.5, Vec3::ZERO), (0.1, Vec3::X), (0.1, Vec3::ONE)],
                    interpolation: ToonInterpolation::Smooth,
                }),
                ..Material::default()
            },
        ],
        positions,
        triangles,
        images: Vec::new(),
        image_places: Vec::new(),
        world_from_mesh: WorldFromMesh { offset: DVec3::new(1e6, 2.0, -3.5), scale: 64.0 },
        undisplaced_bounds: None,
    }
}

/// A tetrahedron without attributes.
pub(crate) fn tetrahedron() -> Mesh {
    Mesh {
        positions: vec![
            Vec3::ONE,
            Vec3::new(1.0, -1.0, -1.0),
            Vec3::new(-1.0, 1.0, -1.0),
            Vec3::new(-1.0, -1.0, 1.0),
        ],
        triangles: vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]],
        materials: vec![Material::default()],
        ..Mesh::default()
    }
}

/// One fan per tile, `extent` by vertex. Directions differ from vertex to vertex; every third tile is "unfolded": its
/// coordinates are stored.
pub(crate) fn fan_cover(mesh: &Mesh, extent: impl Fn(usize) -> [u32; 2]) -> Cover {
    let groups: Vec<Group> = (0..mesh.positions.len())
        .map(|v| {
            let direction = Vec3::new((v as f32).sin() * 0.2, (v as f32).cos() * 0.2, 1.0).normalize();
            let x_axis = direction.cross(Vec3::new(0.3, 1.0, 0.1)).normalize();
            Group {
                kind: if v % 3 == 2 { GroupKind::Unfolded } else { GroupKind::Projected },
                frame: Frame { origin: mesh.positions[v], direction, x_axis },
                uv_scale: Vec2::splat(0.7),
                uv_offset: Vec2::splat(0.5),
                extent: extent(v),
            }
        })
        .collect();
    let mut unfolded = Vec::new();
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        for (k, &v) in triangle.iter().enumerate() {
            let group = &groups[v as usize];
            if group.kind == GroupKind::Unfolded {
                let uv = mesh.triangle_positions(t).map(|p| group.tile_from_mesh(p));
                unfolded.push(UnfoldedCorner { corner: (3 * t + k) as u32, uv });
            }
        }
    }
    let corner_groups = mesh.triangles.clone();
    Cover {
        delta: 0.25,
        density: 100.0,
        is_creased: false,
        hard_edges: None,
        is_paired_by_angle: false,
        corner_groups,
        groups,
        unfolded: unfolded.into(),
    }
}

/// The channels of a painted model in block formats.
pub(crate) fn block_channels() -> Vec<Channel> {
    vec![
        Channel { kind: ChannelKind::BaseColor, format: TexelFormat::Bc7, srgb: true },
        Channel { kind: ChannelKind::Normal, format: TexelFormat::Bc5, srgb: false },
        Channel { kind: ChannelKind::OcclusionRoughnessMetallic, format: TexelFormat::Bc1, srgb: false },
        Channel { kind: ChannelKind::Displacement, format: TexelFormat::Bc4, srgb: false },
    ]
}

/// Channels of all uncompressed formats.
pub(crate) fn plain_channels() -> Vec<Channel> {
    vec![
        Channel { kind: ChannelKind::BaseColor, format: TexelFormat::Rgba8, srgb: true },
        Channel { kind: ChannelKind::Normal, format: TexelFormat::Rg8, srgb: false },
        Channel { kind: ChannelKind::Emission, format: TexelFormat::Rgba32F, srgb: false },
        Channel { kind: ChannelKind::Displacement, format: TexelFormat::R8, srgb: false },
    ]
}

/// Texels of a page in stored encoding: waves that differ between tiles and channels, at every level those of the finest.
pub(crate) fn page_texels(cover: &Cover, id: PageId, channel: usize) -> ([u32; 2], Vec<[f32; 4]>) {
    let level_extent = cover.groups[id.group as usize].level_extent(id.level);
    let [width, height] = page_extent(level_extent, id.page);
    let [x0, y0] = page_origin(id.page);
    let phase = id.group as f32 + 3.0 * channel as f32;
    let finest = cover.groups[id.group as usize].extent;
    let scale = [0, 1].map(|k| finest[k] as f32 / level_extent[k] as f32);
    let texels = (0..width * height)
        .map(|i| {
            let [x, y] = [x0 + i % width, y0 + i / width].map(|n| n as f32 + 0.5);
            let (x, y) = (x * scale[0], y * scale[1]);
            let wave = |kx: f32, ky: f32| 0.5 + 0.5 * (kx * x + ky * y + phase).sin();
            [wave(0.2, 0.13), wave(-0.11, 0.3), wave(0.07, 0.09), 1.0]
        })
        .collect();
    ([width, height], texels)
}

/// One page, encoded.
pub(crate) fn encoded_page(cover: &Cover, channels: &[Channel], id: PageId) -> EncodedPage {
    let encoded = channels.iter().enumerate().map(|(index, channel)| {
        let (extent, texels) = page_texels(cover, id, index);
        encode(channel.format, Quality::UltraFast, extent, TexelSlice::F32(&texels)).unwrap()
    });
    EncodedPage { id, channels: encoded.collect() }
}

/// All pages of a cover in the writer's order.
pub(crate) fn pages(cover: &Cover) -> impl Iterator<Item = PageId> + '_ {
    cover.groups.iter().enumerate().flat_map(|(g, group)| group_pages(g as u32, group))
}

/// Means that tell groups and channels apart.
pub(crate) fn means(cover: &Cover, channels: &[Channel]) -> Vec<[f32; 4]> {
    (0..cover.groups.len() * channels.len()).map(|i| [i as f32 / 1024.0, 0.25, 0.5, 1.0]).collect()
}

/// Writes an asset in batches of `batch` pages.
pub(crate) fn write(
    path: &Path,
    mesh: &Mesh,
    cover: &Cover,
    channels: &[Channel],
    batch: usize,
) -> fantex_base::Result<WriteSummary> {
    let options = CreateOptions { force: true, ..CreateOptions::default() };
    let mut writer = AssetWriter::create(path, &options, mesh, cover, channels)?;
    let all: Vec<PageId> = pages(cover).collect();
    for ids in all.chunks(batch) {
        writer.write_pages(ids.iter().map(|&id| encoded_page(cover, channels, id)).collect())?;
    }
    writer.finish(&means(cover, channels))
}
