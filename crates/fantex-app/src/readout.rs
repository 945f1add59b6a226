//! What the pointer is on: the triangle, the tile and its texel, the level that is drawn, and what the channels hold there.
//!
//! ```text
//!  pointer --ray--> Spot: triangle, tiles, wanted levels --> what is drawn of them (SceneView)
//!                     |
//!                     '--> values, read in the background; of what is painted on by its painter
//! ```

use fantex::SurfacePoint;
use fantex::cover::Cover;
use fantex::glam::{DVec2, DVec3, Vec2, Vec3, Vec4};
use fantex::mesh::Mesh;
use fantex::scene::FilterOptions;
use fantex::store::{ChannelKind, PageCache, TileId, TileLookup, TileSource};
use fantex::texture::color::srgb_from_linear;

use crate::display::ShadingView;
use crate::job::Job;
use crate::paint::{Viewpoint, text_hex};
use crate::text::grouped;

/// Seconds for which values of another point stand in for those that are being read.
const STAND_IN_SECONDS: f64 = 0.3;

/// A point of a model, and what is read there.
#[derive(Clone, Debug, PartialEq)]
pub struct Spot {
    pub point: SurfacePoint,
    /// The tile with the most weight first; none of models without tiles.
    pub tiles: Vec<TileSpot>,
}

/// A tile that is read at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileSpot {
    pub group: u32,
    /// Share of the value.
    pub weight: f32,
    /// Place in the tile, 0..1 along its sides.
    pub uv: Vec2,
    /// Change of that from pixel to pixel, to the right and downwards.
    pub steps: [Vec2; 2],
    /// The finer of the two levels that the pixel asks for, and the share of the other one.
    pub wanted: (u32, f32),
}

impl Spot {
    /// A point that is seen at a place of the picture, 0..1 along its sides.
    pub fn new(
        mesh: &Mesh,
        cover: Option<&Cover>,
        point: SurfacePoint,
        (view, at): (&Viewpoint, DVec2),
        filter: &FilterOptions,
    ) -> Self {
        let place = mesh.world_from_mesh;
        let corners = mesh.triangle_positions(point.index()).map(|corner| place.point(corner));
        let steps = lambda_steps(corners, view, at);
        let mut tiles = Vec::new();
        if let Some(cover) = cover {
            for tap in cover.taps(mesh, point) {
                let (group, steps) = (&cover.groups[tap.group as usize], tap.steps(steps));
                let wanted = TileLookup::new(tap.group, group, tap.uv, steps, filter).levels();
                tiles.push(TileSpot { group: tap.group, weight: tap.weight, uv: tap.uv, steps, wanted });
            }
        }
        tiles.sort_by(|a, b| b.weight.total_cmp(&a.weight));
        Self { point, tiles }
    }
}

/// Change of the barycentric coordinates in a triangle's plane from a pixel to the next one, to the right and downwards.
fn lambda_steps(corners: [DVec3; 3], view: &Viewpoint, at: DVec2) -> [Vec3; 2] {
    let [width, height] = view.pixels.map(|n| 1.0 / f64::from(n.max(1)));
    let lambda = |at: DVec2| on_plane(corners, view.rig.eye, view.rig.ray(at, view.aspect()));
    [DVec2::new(width, 0.0), DVec2::new(0.0, height)].map(|step| match (lambda(at), lambda(at + step)) {
        (Some(here), Some(next)) => (next - here).as_vec3(),
        // Seen edge-on.
        _ => Vec3::ZERO,
    })
}

/// Barycentric coordinates of where a ray meets a triangle's plane.
fn on_plane([a, b, c]: [DVec3; 3], eye: DVec3, ray: DVec3) -> Option<DVec3> {
    let (ab, ac, to_eye) = (b - a, c - a, eye - a);
    let across = ray.cross(ac);
    let determinant = ab.dot(across);
    let (beta, gamma) = (to_eye.dot(across) / determinant, ray.dot(to_eye.cross(ab)) / determinant);
    Some(DVec3::new(1.0 - beta - gamma, beta, gamma)).filter(|lambda| lambda.is_finite())
}

/// What the channels hold at a point, as it is stored: colours linear, normals in the frame of their tile.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Values {
    pub point: SurfacePoint,
    /// Per channel; none where they cannot be read.
    pub channels: Vec<Vec4>,
    /// When they came, seconds.
    pub since: f64,
}

/// A spot whose values are asked for, and the finest level of each of its tiles that is looked at.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Asked {
    pub(crate) spot: Spot,
    pub(crate) finest: Vec<u32>,
}

impl Asked {
    /// Reads the values at the levels that are drawn.
    pub(crate) fn read(&self, cache: &PageCache, filter: &FilterOptions) -> Vec<Vec4> {
        let asset = cache.asset();
        let mut values = vec![Vec4::ZERO; asset.channels().len()];
        for (tile, &finest) in self.spot.tiles.iter().zip(&self.finest) {
            let group = &asset.cover().groups[tile.group as usize];
            let lookup = TileLookup::new(tile.group, group, tile.uv, tile.steps, filter);
            let drawn = DrawnTiles { cache, finest };
            for (channel, value) in values.iter_mut().enumerate() {
                *value += lookup.sample(&drawn, channel) * tile.weight;
            }
        }
        values
    }
}

/// Tiles as far as they are drawn: finer levels are not there.
struct DrawnTiles<'a> {
    cache: &'a PageCache,
    finest: u32,
}

impl TileSource for DrawnTiles<'_> {
    type Tile = <PageCache as TileSource>::Tile;

    fn tile(&self, channel: usize, id: TileId) -> Self::Tile {
        self.cache.tile(channel, TileId { level: id.level.max(self.finest), ..id })
    }

    fn mean(&self, channel: usize, group: u32) -> [f32; 4] {
        self.cache.mean(channel, group)
    }
}

/// What is known of what the pointer is on.
#[derive(Debug, Default)]
pub struct Readout {
    /// None beside the model.
    pub spot: Option<Spot>,
    /// Per tile of the spot the finest level that is in graphics memory there, of those from the wanted one on, and of those from the next
    /// one on; none where that is the mean only. Empty where it is not known.
    drawn: Vec<[Option<u32>; 2]>,
    /// What the channels hold, of an asset that is only looked at.
    pub(crate) values: Option<Values>,
    pub(crate) job: Option<Job<Vec<Vec4>>>,
    pub(crate) asked: Option<Asked>,
    pub(crate) cache: Option<PageCache>,
}

impl Readout {
    /// The pointer is on something else.
    pub(crate) fn move_to(&mut self, spot: Option<Spot>) {
        if self.spot != spot {
            self.spot = spot;
            self.drawn.clear();
        }
    }

    /// Takes over what is drawn. `drawn_level` tells the finest level from one on that a group has at a place of its tile.
    pub fn follow(&mut self, drawn_level: impl Fn(u32, u32, Vec2) -> Option<u32>) {
        let Some(spot) = &self.spot else { return };
        let of_tile = |tile: &TileSpot| [0, 1].map(|k| drawn_level(tile.group, tile.wanted.0 + k, tile.uv));
        self.drawn = spot.tiles.iter().map(of_tile).collect();
    }

    /// Per tile of the spot the finest level that is looked at.
    pub(crate) fn finest(&self, cover: &Cover) -> Vec<u32> {
        let Some(spot) = &self.spot else { return Vec::new() };
        let finest = |(index, tile): (usize, &TileSpot)| match self.drawn.get(index) {
            Some([drawn, _]) => drawn.unwrap_or(cover.groups[tile.group as usize].level_count() - 1),
            None => tile.wanted.0,
        };
        spot.tiles.iter().enumerate().map(finest).collect()
    }

    /// Triangle, tile, level and texel; of a model its material and texture coordinates. None beside the model.
    pub fn place(&self, mesh: &Mesh, cover: Option<&Cover>) -> Option<String> {
        let spot = self.spot.as_ref()?;
        let mut parts = vec![format!("Triangle {}", grouped(u64::from(spot.point.triangle)))];
        match (cover, spot.tiles.first()) {
            (Some(cover), Some(tile)) => {
                let group = cover.groups.get(tile.group as usize)?;
                let level = self.finest(cover).first().copied().unwrap_or(0).min(group.level_count() - 1);
                let [columns, rows] = group.level_extent(level);
                let texel = |at: f32, count: u32| ((at * count as f32) as u32).min(count - 1);
                let [x, y] = [texel(tile.uv.x, columns), texel(tile.uv.y, rows)];
                parts.push(format!("tile {}", grouped(u64::from(tile.group))));
                parts.push(self.level(tile, group.level_count()));
                parts.push(format!("texel {x}, {y} of {columns} × {rows}"));
            }
            _ => {
                let material = mesh.materials.get(mesh.material_of(spot.point.index()));
                let name = material.map_or("", |material| material.name.as_str());
                parts.extend((!name.is_empty()).then(|| format!("material {name}")));
                if let Some(set) = mesh.corners.uv_sets.first().filter(|set| !set.is_empty()) {
                    let uv = spot.point.interpolate(spot.point.corner_values(set));
                    parts.push(format!("texture coordinates {:.4}, {:.4}", uv.x, uv.y));
                }
            }
        }
        Some(parts.join(" · "))
    }

    /// The level that is drawn, and the wanted one where that is another.
    fn level(&self, tile: &TileSpot, level_count: u32) -> String {
        let (fine, share) = tile.wanted;
        let wanted = fine as f32 + share;
        let Some(&[finer, coarser]) = self.drawn.first() else {
            return format!("level {}", level_text(wanted));
        };
        let Some(finer) = finer else { return "mean of the tile".into() };
        let coarser = coarser.unwrap_or(level_count);
        let drawn = finer as f32 * (1.0 - share) + coarser as f32 * share;
        if drawn > wanted + 0.05 {
            return format!("level {} instead of {}", level_text(drawn), level_text(wanted));
        }
        format!("level {}", level_text(drawn))
    }
}

impl Values {
    /// Whether they are those of a point, or young enough to stand in for them.
    pub(crate) fn are_of(&self, point: SurfacePoint, now: f64) -> bool {
        self.point == point || now - self.since < STAND_IN_SECONDS
    }

    /// Those of the channels that are shown.
    pub fn text(
        &self,
        kinds: impl Iterator<Item = ChannelKind>,
        shows: impl Fn(ChannelKind) -> bool,
    ) -> String {
        let shown = kinds.zip(&self.channels).filter(|(kind, _)| shows(*kind));
        shown.map(|(kind, value)| channel_text(kind, *value)).collect::<Vec<_>>().join(" · ")
    }
}

/// Whether a view of the shading shows a channel.
pub fn is_shown(view: ShadingView, kind: ChannelKind) -> bool {
    view == ShadingView::Lit || ShadingView::of_channel(kind) == Some(view)
}

/// A level between two with a decimal.
fn level_text(level: f32) -> String {
    let whole = level.round();
    if (level - whole).abs() < 0.05 { format!("{whole:.0}") } else { format!("{level:.1}") }
}

/// A value with the name of its channel.
fn channel_text(kind: ChannelKind, value: Vec4) -> String {
    let [x, y, z, w] = value.to_array();
    let three = |name: &str| format!("{name} {x:.3} {y:.3} {z:.3}");
    match kind {
        ChannelKind::BaseColor => {
            let byte = |c: f32| (srgb_from_linear(c) * 255.0).round().clamp(0.0, 255.0) as u8;
            let opacity = if w < 0.995 { format!(", opacity {w:.2}") } else { String::new() };
            format!("{} ({}){opacity}", three("base colour"), text_hex([x, y, z].map(byte)))
        }
        ChannelKind::OcclusionRoughnessMetallic => {
            format!("occlusion {x:.2}, roughness {y:.2}, metallic {z:.2}")
        }
        ChannelKind::Emission => three("emission"),
        ChannelKind::Light => three("light"),
        ChannelKind::Normal => format!("normal {x:.3} {y:.3}"),
        ChannelKind::Anisotropy => format!("anisotropy {x:.3} {y:.3}"),
        ChannelKind::Displacement => format!("height {x:.3}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::CameraRig;

    #[test]
    fn steps_are_those_of_pixels() {
        // A triangle that faces the camera: 2 units wide and high, 3 units away.
        let corners = [DVec3::new(-1.0, -1.0, 0.0), DVec3::new(1.0, -1.0, 0.0), DVec3::new(-1.0, 1.0, 0.0)];
        let view = Viewpoint { rig: CameraRig::default(), pixels: [400, 400], pixels_per_point: 1.0 };
        let [right, down] = lambda_steps(corners, &view, DVec2::splat(0.45));
        let pixel = view.world_per_pixel(DVec3::ZERO) as f32;
        for (step, expected) in
            [(right, Vec3::new(-0.5, 0.5, 0.0) * pixel), (down, Vec3::new(0.5, 0.0, -0.5) * pixel)]
        {
            assert!((step - expected).length() < 1e-3 * pixel, "{step} {expected}");
        }
    }

    #[test]
    fn the_level_that_is_drawn_is_told_beside_the_wanted_one() {
        let tile =
            TileSpot { group: 3, weight: 1.0, uv: Vec2::ZERO, steps: [Vec2::ZERO; 2], wanted: (1, 0.3) };
        let spot = Spot { point: SurfacePoint::default(), tiles: vec![tile] };
        let mut readout = Readout::default();
        readout.move_to(Some(spot));
        assert_eq!(readout.level(&tile, 6), "level 1.3");
        readout.follow(|_, level, _| Some(level));
        assert_eq!(readout.level(&tile, 6), "level 1.3");
        readout.follow(|_, level, _| Some(level.max(4)));
        assert_eq!(readout.level(&tile, 6), "level 4 instead of 1.3");
        readout.follow(|_, _, _| None);
        assert_eq!(readout.level(&tile, 6), "mean of the tile");
    }

    #[test]
    fn values_are_told_with_their_channels() {
        let values = Values {
            channels: vec![Vec4::new(1.0, 0.0, 0.0, 0.5), Vec4::new(1.0, 0.25, 0.0, 1.0)],
            ..Values::default()
        };
        let kinds = [ChannelKind::BaseColor, ChannelKind::OcclusionRoughnessMetallic];
        let text = |view| values.text(kinds.into_iter(), |kind| is_shown(view, kind));
        let color = "base colour 1.000 0.000 0.000 (#ff0000), opacity 0.50";
        assert_eq!(text(ShadingView::BaseColor), color);
        let material = "occlusion 1.00, roughness 0.25, metallic 0.00";
        assert_eq!(text(ShadingView::Lit), format!("{color} · {material}"));
        assert_eq!(text(ShadingView::Emission), "");
    }
}
