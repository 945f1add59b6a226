//! Surface-detail polygons, baked.

#![allow(clippy::unwrap_used, reason = "tests may unwrap")]

mod common;

use common::{Constant, baked, cleaned, cover, float_options, sample};
use fantex_bake::{DetailPlacement, DetailSource, DetailSourceError, Fit};
use fantex_mesh::{TriangleBvh, generate};
use fantex_store::ChannelKind;
use fantex_texture::{DetailPlane, DetailPolygon, SurfaceDetail};
use glam::{Vec2, Vec3, Vec4};

const WALL: Vec4 = Vec4::new(0.2, 0.2, 0.2, 1.0);
const GLASS: Vec4 = Vec4::new(0.1, 0.4, 0.9, 1.0);

/// A window from 0.5 to 1 along both axes, on a square of side 2.
fn window() -> SurfaceDetail {
    let corners = [[0.5, 0.5], [1.0, 0.5], [1.0, 1.0], [0.5, 1.0]].map(Vec2::from).to_vec();
    SurfaceDetail::new(&[DetailPolygon { outlines: vec![corners], material: 0, priority: 0 }]).unwrap()
}

#[test]
fn windows_are_baked_where_they_are_and_nowhere_else() {
    let mesh = cleaned(generate::cube(1));
    // The top: its plane has its origin in a corner and its axes along two edges.
    let is_top = |t: &usize| mesh.triangle_positions(*t).iter().all(|p| p.y > 0.99);
    let triangles: Vec<u32> = (0..mesh.triangles.len()).filter(is_top).map(|t| t as u32).collect();
    assert_eq!(triangles.len(), 2);
    let plane = DetailPlane { origin: Vec3::new(-1.0, 1.0, -1.0), axes: [Vec3::X, Vec3::Z] };
    let placement = DetailPlacement::Face { plane, triangles };
    let wall = Constant(vec![(ChannelKind::BaseColor, WALL)]);
    let detail = window();
    let source = DetailSource::new(&mesh, &wall, &detail, placement, vec![GLASS]).unwrap();
    let cover = cover(&mesh, 64, 60_000);
    let asset = baked(&mesh, &cover, &source, &float_options(Fit::Box));
    let bvh = TriangleBvh::new(&mesh);
    let read = |p: Vec3| {
        let nearest = bvh.nearest_point(p, 1e-3).unwrap();
        sample(&asset.cache, 0, 0, nearest.triangle, nearest.lambda)
    };
    for (x, z, color) in
        [(-0.25, -0.25, GLASS), (-0.45, -0.05, GLASS), (-0.55, -0.25, WALL), (0.5, 0.5, WALL)]
    {
        assert!(read(Vec3::new(x, 1.0, z)).distance(color) < 1e-4, "{x} {z}: {}", read(Vec3::new(x, 1.0, z)));
        assert!(read(Vec3::new(x, -1.0, z)).distance(WALL) < 1e-4);
    }
    // On the border both meet.
    let border = read(Vec3::new(-0.5, 1.0, -0.25));
    assert!(border.z > WALL.z + 0.02 && border.z < GLASS.z - 0.02, "{border}");
}

#[test]
fn what_cannot_be_placed_is_refused() {
    let mesh = cleaned(generate::cube(1));
    let wall = Constant(vec![(ChannelKind::BaseColor, WALL)]);
    let glow = Constant(vec![(ChannelKind::Emission, WALL)]);
    let detail = window();
    let face = || DetailPlacement::Face {
        plane: DetailPlane { origin: Vec3::ZERO, axes: [Vec3::X, Vec3::Z] },
        triangles: vec![0],
    };
    let refused =
        |below, placement, colors| DetailSource::new(&mesh, below, &detail, placement, colors).err();
    let no_uv = Some(DetailSourceError::NoUvSet { uv_set: 0, available: 0 });
    assert_eq!(refused(&wall, DetailPlacement::UvSet(0), vec![GLASS]), no_uv);
    assert_eq!(refused(&glow, face(), vec![GLASS]), Some(DetailSourceError::NoBaseColor));
    assert_eq!(refused(&wall, face(), vec![]), Some(DetailSourceError::NoColor { material: 0, colors: 0 }));
}
