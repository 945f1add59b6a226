//! Textures asked once for all texels of a triangle.

use std::cell::RefCell;

use fantex_texture::{ShadingPoint, Texture, UvPoint};
use glam::{Vec2, Vec4};

/// The value of a texture at the point in question, moved by so many of the texel's edges.
pub(super) type Ask<'a> = dyn Fn(&dyn Texture, Vec2) -> Vec4 + 'a;

/// Asks at one point.
pub(super) fn ask_at(at: &ShadingPoint<'_>, texture: &dyn Texture, offset: Vec2) -> Vec4 {
    if offset == Vec2::ZERO {
        return texture.evaluate(at);
    }
    at.shifted(offset.x, offset.y, |there| texture.evaluate(there))
}

/// What textures answer at many points. Each is asked at all of them as soon as it is asked at one; texels of a triangle have the same
/// material and the same edges, so that is what will be wanted.
pub(super) struct Answers<'a> {
    at: &'a [ShadingPoint<'a>],
    columns: RefCell<Vec<Column>>,
}

struct Column {
    /// Where the texture lies in memory tells it from others.
    texture: *const (),
    offset: Vec2,
    values: Vec<Vec4>,
}

impl<'a> Answers<'a> {
    pub(super) fn new(at: &'a [ShadingPoint<'a>]) -> Self {
        Self { at, columns: RefCell::default() }
    }

    /// The answer at one of the points.
    pub(super) fn ask(&self, index: usize, texture: &dyn Texture, offset: Vec2) -> Vec4 {
        let address = std::ptr::from_ref(texture).cast::<()>();
        let mut columns = self.columns.borrow_mut();
        let known = columns.iter().position(|c| c.texture == address && c.offset == offset);
        let column = known.unwrap_or_else(|| {
            columns.push(Column { texture: address, offset, values: self.values(texture, offset) });
            columns.len() - 1
        });
        columns[column].values[index]
    }

    fn values(&self, texture: &dyn Texture, offset: Vec2) -> Vec<Vec4> {
        let mut values = vec![Vec4::ZERO; self.at.len()];
        if offset == Vec2::ZERO {
            texture.evaluate_all(self.at, &mut values);
        } else {
            texture.evaluate_all(&self.moved(offset, &mut Vec::new()), &mut values);
        }
        values
    }

    /// The points moved by so many of their texels' edges; their texture coordinates lie in `uv`.
    fn moved<'u>(&self, offset: Vec2, uv: &'u mut Vec<UvPoint>) -> Vec<ShadingPoint<'u>> {
        let Some(sets) = self.at.first().map(|at| at.uv.len()) else { return Vec::new() };
        let mut places = Vec::with_capacity(self.at.len());
        for at in self.at {
            at.shifted(offset.x, offset.y, |there| {
                uv.extend_from_slice(there.uv);
                places.push((there.position, there.normal));
            });
        }
        let uv: &'u [UvPoint] = uv;
        let moved = self.at.iter().zip(places).enumerate().map(|(index, (at, (position, normal)))| {
            let uv = &uv[index * sets..(index + 1) * sets];
            ShadingPoint { position, normal, uv, ..*at }
        });
        moved.collect()
    }
}
