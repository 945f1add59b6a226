//! Coverage to texels: a page as it is after the stroke.

use fantex_base::Result;
use fantex_cover::{Tap, TexelTriangle};
use fantex_mesh::interpolate;
use fantex_store::{
    Asset, AssetEditor, Channel, ChannelKind, PAGE, PageCache, PageId, PageTexels, Quality, TexelFormat,
    TexelSlice, TileId, TileSource, TileTexels, encode_many,
};
use fantex_texture::color::{srgb_from_linear, srgb8_from_linear, unorm8};
use fantex_texture::material::vertex_color;
use fantex_texture::{Filtering, ShadingPoint, UvPoint};
use glam::{DVec3, Vec2, Vec3, Vec4};

use crate::cover::{Patch, TexelUnder, Touch};
use crate::dab::PlacedDab;
use crate::relief::Relief;
use crate::stroke::walk_straight;
use crate::stroke_page::StrokePage;
use crate::texel_page::{Rect, TexelPage, blocks_of};
use crate::{ChannelPaint, Paint, PaintColor, Region, Surface, SurfacePoint, Tool};

/// The bytes of a page in all painted channels: `shown` with the blocks of stale texels replaced, from those before the
/// stroke.
pub(crate) fn composite(
    asset: &Asset,
    map: &TexelPage,
    id: PageId,
    page: &StrokePage,
    shown: Vec<Vec<u8>>,
    context: &PaintContext<'_>,
) -> Result<Vec<Vec<u8>>> {
    let extent = map.block.extent;
    let mut changed = Vec::with_capacity(context.paint.channels.len());
    let relief = context.painted_relief();
    let rect = match relief {
        Some(_) => Relief::reach(page.stale, extent).blocks(),
        None => page.stale.blocks(),
    };
    // Heights around count, too.
    let evaluated = if relief.is_some() { Relief::reach(rect, extent) } else { rect };
    let originals = match page.decoded.get() {
        Some(decoded) => decoded,
        None => {
            let decoded = decode(asset, id, page, context)?;
            page.decoded.get_or_init(|| decoded)
        }
    };
    let channels = context.paint.channels.iter().enumerate();
    let mut painted_values = Vec::with_capacity(context.paint.channels.len());
    for ((number, painted), original) in channels.zip(originals) {
        let mut values = original.clone();
        for place in evaluated.texels() {
            let texel = map.texel(place);
            let coverage = page.covered(texel);
            if coverage > 0.0
                && map.is_valid(texel)
                && let Some(color) = context.color(map, page, place, number)
            {
                values[texel] =
                    painted.keep(values[texel], context.paint.apply(values[texel], color, coverage));
            }
        }
        painted_values.push(values);
    }
    let mut is_bent = Vec::new();
    if let Some((relief, [height, normal])) = relief {
        is_bent = vec![false; map.owner.len()];
        let mut normals = std::mem::take(&mut painted_values[normal]);
        let heights = [originals[height].as_slice(), &painted_values[height]];
        relief.bend(context.surface, map, rect, heights, &mut normals, |texel| is_bent[texel] = true);
        painted_values[normal] = normals;
    }
    let channels = context.paint.channels.iter().enumerate();
    for (((number, painted), values), mut bytes) in channels.zip(painted_values).zip(shown) {
        let channel = &asset.channels()[painted.channel];
        let follows = relief.is_some_and(|(_, [_, normal])| normal == number);
        if follows {
            // What was bent may be straight by now.
            copy_blocks(channel, extent, &page.originals[number], &mut bytes, rect);
        }
        let is_changed =
            |texel: usize| map.is_known(texel) && (page.covered(texel) > 0.0 || follows && is_bent[texel]);
        replace_blocks(channel, extent, &mut bytes, &values, rect, is_changed)?;
        changed.push(bytes);
    }
    Ok(changed)
}

/// The texels before the stroke, per painted channel.
fn decode(
    asset: &Asset,
    id: PageId,
    page: &StrokePage,
    context: &PaintContext<'_>,
) -> Result<Vec<Vec<Vec4>>> {
    let channels = context.paint.channels.iter().zip(&page.originals);
    let decoded = channels.map(|(painted, original)| {
        let texels = asset.decode_page_raw(painted.channel, id, original)?;
        Ok(texels.rgba.into_iter().map(Vec4::from).collect())
    });
    decoded.collect()
}

// What colour a stroke lays on a texel.

/// The colours of a stroke.
pub(crate) struct PaintContext<'a> {
    pub(crate) surface: &'a Surface,
    pub(crate) paint: &'a Paint,
    /// The texture function before the stroke, where the tool asks for it.
    pub(crate) before: Option<&'a PageCache>,
    normals: Option<usize>,
    relief: Option<Relief>,
}

/// Points of a ring around the centre of a blur.
const RING: u32 = 6;

/// Rings at these shares of the radius, with the weight of each point; the centre weighs 1. (A Gaussian with a standard
/// deviation of half the radius.)
const RINGS: [(f64, f32); 2] = [(0.5, 0.607), (1.0, 0.135)];

impl<'a> PaintContext<'a> {
    pub(crate) fn new(
        surface: &'a Surface,
        asset: &Asset,
        paint: &'a Paint,
        before: Option<&'a PageCache>,
    ) -> Self {
        let normals = asset.channel_of_kind(ChannelKind::Normal);
        Self { surface, paint, before, normals, relief: Relief::of(surface, asset) }
    }

    /// Where the stroke paints heights that show in normals: the numbers of both among the painted channels.
    fn painted_relief(&self) -> Option<(Relief, [usize; 2])> {
        let relief = self.relief?;
        let number = |channel| self.paint.channels.iter().position(|painted| painted.channel == channel);
        Some((relief, [number(relief.height)?, number(relief.normal)?]))
    }

    /// The colour of a channel, by its number among the painted ones, at a texel that shows the surface, given by column and
    /// row; none where there is nothing to lay down.
    pub(crate) fn color(
        &self,
        map: &TexelPage,
        page: &StrokePage,
        place: [u32; 2],
        number: usize,
    ) -> Option<Vec4> {
        let painted = &self.paint.channels[number];
        if matches!(painted.color, PaintColor::Relief) {
            return None;
        }
        let value = page.color(number, map.texel(place)).or_else(|| self.at(map, place, painted, 0))?;
        if !self.is_tangent(painted) {
            return Some(value);
        }
        Some(stored_from_tangent(self.surface, map.group, map.point(place).clamped(), value))
    }

    /// True where the colour is the tangent part of a normal: not what a tile stores.
    pub(crate) fn is_tangent(&self, painted: &ChannelPaint) -> bool {
        let is_picture = matches!(painted.color, PaintColor::Image(_) | PaintColor::Projected(_));
        Some(painted.channel) == self.normals && (is_picture || self.paint.tool.reads_surface())
    }

    /// The same for what does not depend on the dabs, but for the copy of the stroke; of normals that are moved the tangent part.
    pub(crate) fn at(
        &self,
        map: &TexelPage,
        place: [u32; 2],
        painted: &ChannelPaint,
        copy: u32,
    ) -> Option<Vec4> {
        let (triangle, point) = (map.triangle(place), map.point(place));
        match (&self.paint.tool, self.before) {
            (Tool::Blur { radius }, Some(before)) => {
                return Some(self.blurred(before, painted.channel, point.clamped(), *radius));
            }
            (Tool::Clone { .. }, Some(before)) => {
                let source = self.clone_source(point, copy)?;
                return Some(look_up(self.surface, before, painted.channel, source));
            }
            _ => {}
        }
        match &painted.color {
            PaintColor::Constant(color) => Some(*color),
            PaintColor::Texture(texture) => {
                Some(shade(self.surface, triangle, point.lambda, |point| texture.evaluate(point)))
            }
            PaintColor::Image(_) | PaintColor::Relief => None,
            PaintColor::Projected(projection) => {
                let point = point.clamped();
                let steps = position_steps(self.surface, triangle);
                let color = match self.paint.stencil {
                    // It says where: sight need not be tested again.
                    Some(_) => projection.color_at(self.surface, point, steps)?,
                    None => projection.at(self.surface, point, steps)?,
                };
                let is_tangent = self.is_tangent(painted);
                Some(if is_tangent { tangent_from_picture(color, projection.axes()) } else { color })
            }
        }
    }

    /// What a clone copies to a point that copy number `copy` of the stroke covers; none where the surface is too far from there.
    fn clone_source(&self, point: SurfacePoint, copy: u32) -> Option<SurfacePoint> {
        let Tool::Clone { offset, reach, symmetry } = &self.paint.tool else { return None };
        let offset = symmetry.moved_direction(offset.as_dvec3(), copy).as_vec3();
        self.surface.nearest(point.position(self.surface.mesh()) + offset, *reach)
    }

    /// The mean around a point, along the surface.
    fn blurred(&self, before: &PageCache, channel: usize, point: SurfacePoint, radius: f32) -> Vec4 {
        let mut sum = look_up(self.surface, before, channel, point);
        let mut total = 1.0;
        let normal = self.surface.facet_normal(point.triangle);
        let axis = normal.any_orthonormal_vector();
        for (share, weight) in RINGS {
            for k in 0..RING {
                let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(RING)).sin_cos();
                let direction: DVec3 = axis * cos + normal.cross(axis) * sin;
                let tap = walk_straight(self.surface, point, direction, share * f64::from(radius));
                sum += look_up(self.surface, before, channel, tap) * weight;
                total += weight;
            }
        }
        sum / total
    }
}

/// A dab of a clone that copies from where its copy of the stroke does.
pub(crate) struct ClonedDab<'a> {
    pub(crate) dab: &'a PlacedDab,
    pub(crate) context: &'a PaintContext<'a>,
}

impl Touch for ClonedDab<'_> {
    fn region(&self) -> &Region {
        self.dab.region()
    }

    fn texels(&self, index: usize, shown: &TexelTriangle) -> Option<[Vec2; 2]> {
        self.dab.texels(index, shown)
    }
}

impl Patch for ClonedDab<'_> {
    fn at(&self, _: &TexelPage, under: &TexelUnder<'_>, colors: &mut [Vec4]) -> f32 {
        let surface = self.context.surface;
        let entry = &self.dab.region.triangles[under.index];
        let covered = self.dab.coverage(entry, under.point.lambda, under.point.position(surface.mesh()));
        if covered <= 0.0 {
            return 0.0;
        }
        let source = self.context.clone_source(under.point, self.dab.copy());
        let (Some(source), Some(before)) = (source, self.context.before) else { return 0.0 };
        for (color, painted) in colors.iter_mut().zip(&self.context.paint.channels) {
            let copied = look_up(surface, before, painted.channel, source);
            *color = (copied.truncate() * copied.w).extend(copied.w);
        }
        covered
    }
}

/// Change of the position along a texel's sides, mesh units.
pub(crate) fn position_steps(surface: &Surface, triangle: &TexelTriangle) -> [Vec3; 2] {
    let corners = surface.mesh().triangle_positions(triangle.triangle as usize);
    triangle.steps.map(|step| interpolate(corners, step))
}

/// The texture function at level 0; **linear** RGBA; of normals the part along the surface (see [`tangent_from_stored`]).
pub(crate) fn look_up(surface: &Surface, cache: &PageCache, channel: usize, point: SurfacePoint) -> Vec4 {
    let is_normal = cache.asset().channels()[channel].kind == ChannelKind::Normal;
    let look_up = |tap: Tap| {
        let stored =
            Vec4::from_array(cache.tile(channel, TileId { group: tap.group, level: 0 }).bilinear(tap.uv));
        let value = if is_normal { tangent_from_stored(surface, tap.group, point, stored) } else { stored };
        tap.weight * value
    };
    surface.cover().taps(surface.mesh(), point).map(look_up).sum()
}

/// The stored value with all changes that are not yet committed. Decodes the pages anew: for single points.
pub(crate) fn look_up_now(
    surface: &Surface,
    editor: &AssetEditor,
    channel: usize,
    point: SurfacePoint,
) -> Result<Vec4> {
    let mut sum = Vec4::ZERO;
    for tap in surface.cover().taps(surface.mesh(), point) {
        let (places, f) = texels_around(surface.cover().groups[tap.group as usize].extent, tap.uv);
        let mut values = [Vec4::ZERO; 4];
        for (value, [x, y]) in values.iter_mut().zip(places) {
            let id = PageId { group: tap.group, level: 0, page: [x / PAGE, y / PAGE] };
            let texels = editor.read_page(channel, id)?;
            *value = Vec4::from_array(texels.rgba[(y % PAGE * texels.extent[0] + x % PAGE) as usize]);
        }
        sum += tap.weight * bilinear(values, f);
    }
    Ok(sum)
}

/// Columns and rows of the texels that a bilinear look-up reads, clamped half a texel inside the tile, and where it lies
/// between them.
pub(crate) fn texels_around(extent: [u32; 2], uv: Vec2) -> ([[u32; 2]; 4], Vec2) {
    let last = Vec2::new(extent[0] as f32, extent[1] as f32) - 1.0;
    let at = (uv * (last + 1.0) - 0.5).clamp(Vec2::ZERO, last);
    let corner = at.floor().as_uvec2();
    let place = |[dx, dy]: [u32; 2]| [(corner.x + dx).min(extent[0] - 1), (corner.y + dy).min(extent[1] - 1)];
    ([[0, 0], [1, 0], [0, 1], [1, 1]].map(place), at.fract())
}

/// The value between four texels of [`texels_around`].
pub(crate) fn bilinear([a, b, c, d]: [Vec4; 4], f: Vec2) -> Vec4 {
    a.lerp(b, f.x).lerp(c.lerp(d, f.x), f.y)
}

// Textures on the surface: from a texel to what textures are asked by.

/// Asks a texture at a texel, given by its triangle and barycentric coordinates: in object space, averaging over the texel,
/// without an eye, at time 0.
pub(crate) fn shade<R>(
    surface: &Surface,
    triangle: &TexelTriangle,
    lambda: Vec3,
    ask: impl FnOnce(&ShadingPoint<'_>) -> R,
) -> R {
    let (mesh, index) = (surface.mesh(), triangle.triangle as usize);
    let space = surface.space();
    let positions = mesh.triangle_positions(index);
    let corners = surface.normals().of_triangle(triangle.triangle);
    let blended = |lambda: Vec3| interpolate(corners, lambda);
    let facet = || surface.facet_normal(triangle.triangle).as_vec3();
    let normal = blended(lambda).try_normalize().unwrap_or_else(facet);
    let length = blended(lambda).length().max(1e-3);
    let normal_steps = triangle.steps.map(|step| {
        let change = blended(step) / length;
        change - normal * normal.dot(change)
    });
    let uv_point = |set: &Vec<Vec2>| {
        let Some(&[a, b, c]) = set.get(3 * index..3 * index + 3) else { return UvPoint::default() };
        let uv = |lambda: Vec3| interpolate([a, b, c], lambda);
        UvPoint { uv: uv(lambda), steps: triangle.steps.map(uv) }
    };
    let uv: Vec<UvPoint> = mesh.corners.uv_sets.iter().map(uv_point).collect();
    ask(&ShadingPoint {
        position: space.point(interpolate(positions, lambda)),
        position_steps: triangle.steps.map(|step| space.vector(interpolate(positions, step))),
        normal,
        normal_steps,
        uv: &uv,
        // Off the triangle, colours must not be extrapolated.
        vertex_color: vertex_color(mesh, index, lambda.clamp(Vec3::ZERO, Vec3::ONE)),
        eye: None,
        time: 0.0,
        filtering: Filtering::Area,
    })
}

// Normals on their way from one place to another.
//
// A tile stores normals in a frame of its own. What is taken from one place and laid down at another goes through the tangent
// plane: the part of a normal along the surface, as a vector in mesh space, with alpha as w. So a flat normal stays flat
// wherever it goes, and values of different tiles can be mixed.

/// From what a tile stores (x and y in 0..1).
pub(crate) fn tangent_from_stored(surface: &Surface, group: u32, point: SurfacePoint, stored: Vec4) -> Vec4 {
    let group = &surface.cover().groups[group as usize];
    group.tangent_from_stored(stored.truncate().truncate(), surface.normal(point)).extend(stored.w)
}

/// To what a tile stores.
fn stored_from_tangent(surface: &Surface, group: u32, point: SurfacePoint, tangent: Vec4) -> Vec4 {
    let group = &surface.cover().groups[group as usize];
    group.stored_from_tangent(tangent.truncate(), surface.normal(point)).extend(0.0).extend(tangent.w)
}

/// From a picture's red and green (x to the right, y upwards) where the picture's axes lie so in mesh space.
pub(crate) fn tangent_from_picture(color: Vec4, [right, up]: [Vec3; 2]) -> Vec4 {
    (right * (2.0 * color.x - 1.0) + up * (2.0 * color.y - 1.0)).extend(color.w)
}

// From values to a page's bytes: only the blocks that changed are encoded, all others keep their bytes, so that painting
// here never blurs there.

/// Replaces the blocks of a page that hold a changed texel. `values`: linear RGBA of the whole page, row-major; `changed`:
/// texels that differ, all of them within `rect`.
pub(crate) fn replace_blocks(
    channel: &Channel,
    extent: [u32; 2],
    bytes: &mut [u8],
    values: &[Vec4],
    rect: Rect,
    changed: impl Fn(usize) -> bool,
) -> Result<()> {
    let rect = rect.blocks();
    let texels = rect.texels().map(|[x, y]| values[(y * extent[0] + x) as usize]);
    let columns = extent[0] as usize;
    let is_changed = |block: Rect| block.texels().any(|[x, y]| changed(y as usize * columns + x as usize));
    let changed: Vec<bool> = blocks_of(rect).map(is_changed).collect();
    let encode = |texels: TexelSlice<'_>| {
        let page = PageTexels { extent: rect.extent(), texels, read: Some(&changed) };
        encode_many(channel.format, Quality::UltraFast, &[page]).map(|mut pages| pages.swap_remove(0))
    };
    let encoded = if channel.format == TexelFormat::Rgba32F {
        let texels: Vec<[f32; 4]> = texels.map(|v| stored_float(channel, v)).collect();
        encode(TexelSlice::F32(&texels))?
    } else {
        let texels: Vec<[u8; 4]> = texels.map(|v| stored_bytes(channel, v)).collect();
        encode(TexelSlice::U8(&texels))?
    };
    for (block, &is_changed) in blocks_of(rect).zip(&changed) {
        if is_changed {
            let from = channel.format.block_ranges(rect.extent()[0], block.relative_to(rect.low).low);
            let to = channel.format.block_ranges(extent[0], block.low);
            from.zip(to).for_each(|(from, to)| bytes[to].copy_from_slice(&encoded[from]));
        }
    }
    Ok(())
}

/// Copies the blocks of a rectangle from one page to another of the same extent.
pub(crate) fn copy_blocks(channel: &Channel, extent: [u32; 2], from: &[u8], to: &mut [u8], rect: Rect) {
    for block in blocks_of(rect.blocks()) {
        for bytes in channel.format.block_ranges(extent[0], block.low) {
            to[bytes.clone()].copy_from_slice(&from[bytes]);
        }
    }
}

fn stored_float(channel: &Channel, value: Vec4) -> [f32; 4] {
    let [r, g, b, a] = value.to_array();
    let [r, g, b] = if channel.srgb { [r, g, b].map(srgb_from_linear) } else { [r, g, b] };
    [r, g, b, a]
}

fn stored_bytes(channel: &Channel, value: Vec4) -> [u8; 4] {
    let [r, g, b, a] = value.to_array();
    let color = if channel.srgb { [r, g, b].map(srgb8_from_linear) } else { [r, g, b].map(unorm8) };
    [color[0], color[1], color[2], stored_alpha(channel.format, a)]
}

/// Opaque blocks of BC7 may decode to 254/255; taken as it is, that would cost opaque pages the better profile, and a
/// little of their opacity with every stroke.
fn stored_alpha(format: TexelFormat, alpha: f32) -> u8 {
    match unorm8(alpha) {
        254 if format == TexelFormat::Bc7 => 255,
        alpha => alpha,
    }
}
