//! From a fan to the texture, step by step: the fan, the part of it that answers, its tile, all tiles blended, and the sheet they share.

use fantex::Result;
use fantex::bake::SolidSource;
use fantex::cover::{Cover, CoverOptions, TexelBudget, build_cover, pack};
use fantex::mesh::{Mesh, ObjectSpace, TriangleBvh};
use fantex::render::{Camera, FilterOptions, FlatShading, FlatSurface, Hit, Lights, RenderOptions, render};
use fantex::store::{Footprint, PageCache, Sampler, Tile, TileId, TileSource, TileTexels};
use fantex::texture::{ColorSpace, Depth, Image, solid_by_name};
use glam::{DVec3, Vec2, Vec3};

use super::{Gallery, Pictures, baked};
use crate::scene::open_model;

/// Linear RGB of the fan, and of what does not belong to it.
const CHOSEN: Vec3 = Vec3::new(0.9, 0.3, 0.03);
const OTHERS: Vec3 = Vec3::splat(0.6);

/// Behind tiles.
const EMPTY: Vec3 = Vec3::splat(0.015);

/// Of the pictures.
const SIZE: [u32; 2] = [960, 720];

/// Texels around the tile in the sheet.
const FRAME: u32 = 6;

pub(super) fn steps(gallery: &Gallery<'_>) -> Pictures {
    let mesh = open_model(&gallery.shipped.file("assets/models/suzanne.ply"), gallery.context)?;
    let options = CoverOptions { budget: TexelBudget::Total(600_000), tile: 0, ..CoverOptions::default() };
    let (cover, _) = build_cover(&mesh, &options)?;
    let bricks = solid_by_name("brick", ObjectSpace::of(&mesh).bounds(), 0)?;
    let asset = baked(&mesh, &cover, &SolidSource::new(&mesh, bricks), gallery)?;
    let sampler = Sampler::of_cache(&asset.cache, FilterOptions::default());
    let options = gallery.options(SIZE);
    let aspect = f64::from(options.width) / f64::from(options.height);
    let camera =
        Camera { fov_degrees: 9.0, ..Camera::framing_mesh(&mesh, DVec3::new(0.2, 0.15, 1.0), aspect) };
    let fan = fan_ahead(&mesh, &cover, &camera);
    let scene = Scene { mesh: &mesh, camera, options };
    let is_in_fan = |hit: &Hit| cover.corner_groups[hit.triangle()].contains(&fan);
    let share = |hit: &Hit| -> f32 {
        let own = cover.taps(&mesh, hit.at).filter(|tap| tap.group == fan);
        own.map(|tap| tap.weight).sum()
    };
    let whole = scene.picture(&|hit| with_sides(hit, if is_in_fan(hit) { CHOSEN } else { OTHERS }))?;
    let part = scene.picture(&|hit| with_sides(hit, OTHERS.lerp(CHOSEN, share(hit))))?;
    let blended = scene.picture(&|hit| sampler.sample_channel(0, hit.at, Footprint::NONE).truncate())?;
    let tile = tile_picture(&asset.cache, &mesh, &cover, fan);
    let sheet = sheet_picture(&asset.cache, &cover, fan);
    let captions = [
        "a fan: the triangles around a vertex",
        "its partial fan: the part that its tile answers for, with the bands to its neighbours",
        "its tile: the texels of its projection, and the fan's triangles",
        "all tiles, blended in the bands",
        "the sheet they share; the tile is framed",
    ];
    let pictures = [whole, part, gallery.reduced(tile)?, blended, gallery.reduced(sheet)?];
    Ok(captions.map(str::to_owned).into_iter().zip(pictures).collect())
}

struct Scene<'m> {
    mesh: &'m Mesh,
    camera: Camera,
    options: RenderOptions,
}

impl Scene<'_> {
    fn picture(&self, color: &(dyn Fn(&Hit) -> Vec3 + Sync)) -> Result<Image> {
        let surface = FlatSurface::new(self.mesh, FlatShading::Smooth, color);
        let lights = Lights::behind(&self.camera);
        Ok(render(self.mesh, &surface, &self.camera, &lights, &self.options)?.picture.to_srgb_image())
    }
}

/// The fan around the vertex that is nearest to the middle of the picture.
fn fan_ahead(mesh: &Mesh, cover: &Cover, camera: &Camera) -> u32 {
    let [eye, target] = [camera.eye, camera.target].map(|place| mesh.world_from_mesh.inverse_point(place));
    let hit = TriangleBvh::new(mesh).first_hit(eye, target - eye, f32::INFINITY);
    hit.map_or(0, |hit| {
        let [a, b, c] = hit.point.lambda.to_array();
        let corner = if a >= b.max(c) { 0 } else { 1 + usize::from(c > b) };
        cover.corner_groups[hit.point.index()][corner]
    })
}

/// A colour, darker where a side of the triangle passes the pixel.
fn with_sides(hit: &Hit, color: Vec3) -> Vec3 {
    let is_on_side = |k: usize| {
        let [right, down] = hit.lambda_steps;
        hit.at.lambda[k] < Vec2::new(right[k], down[k]).length()
    };
    if (0..3).any(is_on_side) { color * 0.2 } else { color }
}

/// An image of linear RGB.
struct Canvas {
    width: u32,
    height: u32,
    texels: Vec<[f32; 4]>,
}

impl Canvas {
    fn new(width: u32, height: u32) -> Self {
        let texels = vec![EMPTY.extend(1.0).to_array(); width as usize * height as usize];
        Self { width, height, texels }
    }

    fn set(&mut self, x: u32, y: u32, color: Vec3) {
        if x < self.width && y < self.height {
            let texel = y as usize * self.width as usize + x as usize;
            self.texels[texel] = color.extend(1.0).to_array();
        }
    }

    /// A tile from a corner on, so many pixels for a texel.
    fn paste(&mut self, tile: &Tile, [left, top]: [u32; 2], scale: u32) {
        let [columns, rows] = tile.extent();
        for y in 0..rows * scale {
            for x in 0..columns * scale {
                let [r, g, b, _] = tile.texel(x / scale, y / scale);
                self.set(left + x, top + y, Vec3::new(r, g, b));
            }
        }
    }

    fn line(&mut self, from: Vec2, to: Vec2, color: Vec3) {
        let steps = (to - from).length().ceil().max(1.0);
        for step in 0..=steps as u32 {
            let at = from.lerp(to, step as f32 / steps);
            if at.cmpge(Vec2::ZERO).all() {
                self.set(at.x as u32, at.y as u32, color);
                self.set(at.x as u32 + 1, at.y as u32, color);
            }
        }
    }

    fn into_image(self) -> Image {
        Image::from_linear_rgb(self.width, self.height, &self.texels).converted(Depth::U8, ColorSpace::Srgb)
    }
}

/// The texels of a tile as squares, and over them the triangles of its fan.
fn tile_picture(cache: &PageCache, mesh: &Mesh, cover: &Cover, fan: u32) -> Image {
    let tile = cache.tile(0, TileId { group: fan, level: 0 });
    let [columns, rows] = tile.extent();
    let [width, height] = SIZE;
    let scale = (width / columns).min(height / rows).max(1);
    let corner = [(width - (columns * scale).min(width)) / 2, (height - (rows * scale).min(height)) / 2];
    let mut canvas = Canvas::new(width, height);
    canvas.paste(&tile, corner, scale);
    let [left, top] = corner.map(|n| n as f32);
    let extent = Vec2::new((columns * scale) as f32, (rows * scale) as f32);
    for (triangle, groups) in cover.corner_groups.iter().enumerate() {
        let Some(slot) = groups.iter().position(|&group| group == fan) else { continue };
        let corners = cover.tile_corners(mesh, triangle, slot);
        let [a, b, c] = corners.map(|uv| Vec2::new(left, top) + uv * extent);
        for (from, to) in [(a, b), (b, c), (c, a)] {
            canvas.line(from, to, Vec3::ONE);
        }
    }
    canvas.into_image()
}

/// All tiles, packed, with a frame around one.
fn sheet_picture(cache: &PageCache, cover: &Cover, fan: u32) -> Image {
    let extents: Vec<[u32; 2]> = cover.groups.iter().map(|group| group.extent).collect();
    let packing = pack(&extents);
    let mut canvas = Canvas::new(packing.width, packing.height);
    for (group, &place) in (0u32..).zip(&packing.positions) {
        canvas.paste(&cache.tile(0, TileId { group, level: 0 }), place, 1);
    }
    let ([left, top], [columns, rows]) = (packing.positions[fan as usize], extents[fan as usize]);
    for y in top.saturating_sub(FRAME)..top + rows + FRAME {
        for x in left.saturating_sub(FRAME)..left + columns + FRAME {
            let is_inside = (left..left + columns).contains(&x) && (top..top + rows).contains(&y);
            if !is_inside {
                canvas.set(x, y, CHOSEN);
            }
        }
    }
    canvas.into_image()
}
