//! Coverage to texels: a page as it is after the stroke.

use fantex_cover::NOBODY;
use fantex_store::{Asset, PageId};
use fantex_texture::{Filtering, ShadingPoint};
use glam::{Vec3, Vec4};

use super::cover::blend;
use super::encode::replace_blocks;
use super::stroke_page::StrokePage;
use super::texel_page::TexelPage;
use crate::{Paint, PaintColor, PaintError, Surface};

/// The bytes of a page in all painted channels, from those before the stroke.
pub(crate) fn composite(
    surface: &Surface,
    asset: &Asset,
    map: &TexelPage,
    id: PageId,
    page: &StrokePage,
    paint: &Paint,
) -> Result<Vec<Vec<u8>>, PaintError> {
    let extent = map.block.extent;
    let mut changed = Vec::with_capacity(paint.channels.len());
    for (painted, original) in paint.channels.iter().zip(&page.originals) {
        let texels = asset.decode_page_raw(painted.channel, id, original)?;
        let mut values: Vec<Vec4> = texels.rgba.into_iter().map(Vec4::from).collect();
        for (x, y) in page.touched.texels() {
            let texel = (y * extent[0] + x) as usize;
            let coverage = page.coverage[texel];
            if coverage > 0.0 && map.owner[texel] != NOBODY {
                let color = color_at(surface, map, [x, y], &painted.color);
                values[texel] = paint.apply(values[texel], color, coverage);
            }
        }
        let mut bytes = original.clone();
        let channel = &asset.channels()[painted.channel];
        replace_blocks(channel, extent, &mut bytes, &values, page.touched, |t| page.coverage[t] > 0.0)?;
        changed.push(bytes);
    }
    Ok(changed)
}

/// A colour at a texel that shows the surface, given by column and row.
pub(crate) fn color_at(surface: &Surface, map: &TexelPage, [x, y]: [u32; 2], color: &PaintColor) -> Vec4 {
    let texture = match color {
        PaintColor::Constant(color) => return *color,
        PaintColor::Texture(texture) => texture,
    };
    let triangle = &map.triangles[map.owner[(y * map.block.extent[0] + x) as usize] as usize];
    let object_from_mesh = surface.mesh().world_from_mesh.scale as f32;
    let point = |lambda: Vec3| blend(surface, triangle.triangle, lambda) * object_from_mesh;
    texture.evaluate(&ShadingPoint {
        position: point(map.lambda(triangle, x, y)),
        position_steps: triangle.steps.map(point),
        normal: surface.facet_normal(triangle.triangle).as_vec3(),
        normal_steps: [Vec3::ZERO; 2],
        uv: &[],
        vertex_color: Vec4::ONE,
        to_eye: None,
        time: 0.0,
        filtering: Filtering::Area,
    })
}
