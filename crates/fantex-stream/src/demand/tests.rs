//! What demand costs, and that every change is told. (Whether it suffices is tested from outside.)

use std::sync::Arc;

use fantex_cover::{CoverOptions, TexelBudget, build_cover};
use fantex_mesh::{CleanOptions, Mesh, clean, generate};
use glam::{Mat3, Vec3};

use super::*;
use crate::shape::cells;
use crate::{CoveredMesh, PageTable};

fn covered(model: fantex_mesh::Model, texels: u64, tile: u32, double_sided: bool) -> CoveredMesh {
    let (mut mesh, _) = clean(model, &CleanOptions::default()).unwrap();
    mesh.materials.iter_mut().for_each(|m| m.double_sided = double_sided);
    let options = CoverOptions { budget: TexelBudget::Total(texels), tile, ..CoverOptions::default() };
    let (cover, _) = build_cover(&mesh, &options).unwrap();
    CoveredMesh { mesh, cover }
}

fn look(eye: Vec3, target: Vec3, fov_degrees: f32) -> StreamView {
    let back = (eye - target).normalize();
    let right = Vec3::Y.cross(back).try_normalize().unwrap_or(Vec3::X);
    let axes = Mat3::from_cols(right, back.cross(right), back);
    StreamView::new(eye, axes, fov_degrees.to_radians(), [1280, 720])
}

fn demand_for(geometry: &CoveredMesh, anisotropy: f32) -> (DemandSurface, Demand) {
    let shapes = Arc::new(crate::shape::TileShapes::new(&geometry.cover));
    let surface = DemandSurface::new(Arc::new(geometry.clone()), shapes);
    let demand = Demand::new(&surface, anisotropy);
    (surface, demand)
}

#[test]
fn a_cut_that_is_too_much_work_is_spread_over_updates() {
    let geometry = covered(generate::icosphere(4), 1 << 20, 0, false);
    let (mut surface, mut demand) = demand_for(&geometry, 16.0);
    let mut details = vec![Detail::HIDDEN; geometry.cover.groups.len()];
    for eye in [Vec3::Z * 3.0, Vec3::X * 1.3, Vec3::new(-0.2, 1.1, -0.3)] {
        let view = look(eye, Vec3::new(0.0, 0.1, 0.0), 60.0);
        let mut updates = 0;
        loop {
            let mut changed = Vec::new();
            demand.update(&mut surface, Some(&view), 200 * GROUP_NANOSECONDS, &mut changed);
            let work = demand.work;
            assert!(
                work.groups as usize + BLOCK_WORK * work.uniform_blocks as usize <= 200 + BLOCK,
                "{work:?}"
            );
            changed.iter().for_each(|&group| details[group as usize] = demand.detail(group));
            assert_eq!(details, demand.details, "a change was not told");
            updates += 1;
            if !demand.is_behind() {
                break;
            }
        }
        assert!(updates > 3, "{updates}");
        demand.update(&mut surface, Some(&view), 200 * GROUP_NANOSECONDS, &mut Vec::new());
        assert_eq!(demand.work, DemandWork::default(), "nothing is left to do");
    }
    // With a camera that never rests all blocks are visited within a few updates.
    let mut course = Vec::new();
    for step in 0..100 {
        let view = look(Vec3::new((step as f32).sin() * 2.0, 0.5, 2.5), Vec3::ZERO, 60.0);
        let mut changed = Vec::new();
        demand.update(&mut surface, Some(&view), 200 * GROUP_NANOSECONDS, &mut changed);
        changed.iter().for_each(|&group| details[group as usize] = demand.detail(group));
        assert_eq!(details, demand.details, "a change was not told");
        course.push(demand.course.travel);
    }
    let seen: Vec<_> = demand.nodes[0].iter().filter(|state| !state.is_hidden).collect();
    assert!(seen.len() > 20);
    assert!(seen.iter().all(|state| state.due.travel > course[70]), "some have waited for thirty updates");
}

#[test]
fn no_picture_and_no_mesh_need_nothing() {
    let geometry = covered(generate::icosphere(2), 1 << 16, 64, true);
    let (mut surface, mut demand) = demand_for(&geometry, 16.0);
    let view = look(Vec3::Z * 3.0, Vec3::ZERO, 50.0);
    let mut changed = Vec::new();
    demand.update(&mut surface, Some(&view), u32::MAX, &mut changed);
    assert_eq!(changed.len(), geometry.cover.groups.len());
    demand.update(&mut surface, Some(&view), u32::MAX, &mut changed);
    assert_eq!(demand.work, DemandWork::default(), "a still camera costs nothing");
    for absent in [None, Some(StreamView { focal_pixels: f32::NAN, ..view })] {
        demand.update(&mut surface, absent.as_ref(), u32::MAX, &mut changed);
        assert!(demand.details.iter().all(|d| !d.is_visible()));
        demand.update(&mut surface, Some(&view), u32::MAX, &mut changed);
        assert!(demand.details.iter().all(|d| d.is_visible()));
    }
    let mut cover = geometry.cover.clone();
    (cover.groups, cover.corner_groups, cover.unfolded) = Default::default();
    let nothing = CoveredMesh { mesh: Mesh::default(), cover };
    let (mut surface, mut demand) = demand_for(&nothing, 16.0);
    demand.update(&mut surface, Some(&view), u32::MAX, &mut changed);
    assert_eq!(PageTable::new(nothing.cover()).len(), 0);
}

#[test]
fn pages_that_are_too_much_work_are_bounded_over_updates() {
    let geometry = covered(generate::icosphere(5), 1 << 24, 4096, false);
    let view = look(Vec3::new(0.3, 0.2, 1.1), Vec3::new(0.1, 0.0, 0.0), 60.0);
    let (mut surface, mut demand) = demand_for(&geometry, 16.0);
    let paged: Vec<u32> = surface.paged.keys().copied().collect();
    assert!(paged.len() > 4, "{} large tiles", paged.len());
    demand.update(&mut surface, Some(&view), u32::MAX, &mut Vec::new());
    assert!(!demand.is_behind());
    let wanted: Vec<_> = paged.iter().map(|&group| demand.pages(group).to_vec()).collect();
    assert!(wanted.iter().any(|pages| pages.len() > 8));

    let (mut surface, mut demand) = demand_for(&geometry, 16.0);
    let mut updates = 0;
    loop {
        demand.update(&mut surface, Some(&view), 200 * GROUP_NANOSECONDS, &mut Vec::new());
        updates += 1;
        for (&group, wanted) in paged.iter().zip(&wanted) {
            let pages = demand.pages(group);
            assert!(pages.iter().all(|page| wanted.contains(page)), "{pages:?} beside {wanted:?}");
        }
        if !demand.is_behind() {
            break;
        }
    }
    assert!(updates > 3, "{updates}");
    for (&group, wanted) in paged.iter().zip(&wanted) {
        assert_eq!(demand.pages(group), wanted);
    }
    demand.update(&mut surface, Some(&view), 200 * GROUP_NANOSECONDS, &mut Vec::new());
    assert_eq!(demand.work, DemandWork::default(), "nothing is left to do");
}

#[test]
fn a_tile_of_many_triangles_does_not_hold_up_an_update() {
    let geometry = covered(generate::grid(96), 1 << 22, 4096, true);
    let view = look(Vec3::new(0.2, 1.0, 0.1), Vec3::ZERO, 60.0);
    let (mut surface, mut demand) = demand_for(&geometry, 16.0);
    let mut updates = 0;
    while updates == 0 || demand.is_behind() {
        demand.update(&mut surface, Some(&view), 200 * GROUP_NANOSECONDS, &mut Vec::new());
        assert!(demand.left <= demand.may_do);
        updates += 1;
        assert!(updates < 10_000, "this does not end");
    }
    let of_group = GroupTriangles::of(&geometry.cover);
    let is_bounded = |&group: &u32| {
        let (shape, detail) = (surface.shapes.of(group), demand.detail(group));
        detail.is_visible() && shape.is_paged() && shape.single_pages(detail).is_none()
    };
    let bounded = (0..geometry.cover.groups.len() as u32).filter(is_bounded);
    let triangles: usize = bounded.map(|group| of_group.of_group(group).len()).sum();
    assert!(triangles > 10_000, "{triangles}");
    // Putting a thousand triangles into a grid is more than these updates may do.
    assert!(updates > triangles / 1024, "{updates} updates, {triangles} triangles");
}

#[test]
fn over_a_page_that_is_wanted_are_others_also_while_the_camera_moves() {
    let geometry = covered(generate::icosphere(5), 1 << 24, 4096, false);
    let (mut surface, mut demand) = demand_for(&geometry, 16.0);
    let paged: Vec<u32> = surface.paged.keys().copied().collect();
    let mut has_been_behind = 0;
    for step in 0..120 {
        let angle = 0.05 * step as f32;
        let eye = Vec3::new(angle.sin(), 0.2, angle.cos()) * (1.15 + 0.1 * (3.0 * angle).sin());
        let view = look(eye, Vec3::new(0.1, 0.0, 0.0), 60.0);
        demand.update(&mut surface, Some(&view), 200 * GROUP_NANOSECONDS, &mut Vec::new());
        has_been_behind += usize::from(demand.is_behind());
        for &group in &paged {
            let shape = surface.shapes.of(group);
            let pages = demand.pages(group);
            assert!(pages.is_sorted_by_key(|page| page.index));
            for wanted in pages {
                let page = shape.page(group, wanted.index);
                if page.level + 1 == shape.level_count() {
                    continue;
                }
                for above in cells(shape.overlapping(page.level, page.page, page.level + 1)) {
                    let index = shape.page_index(page.level + 1, above);
                    let over = pages.iter().find(|page| page.index == index);
                    let is_own = index < shape.own_pages();
                    assert!(
                        !is_own || over.is_some_and(|over| over.detail <= wanted.detail),
                        "step {step}, {page:?}"
                    );
                }
            }
        }
    }
    assert!(has_been_behind > 20, "{has_been_behind}");
}
