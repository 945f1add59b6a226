//! Surface-detail polygons: coplanar polygons attached to a base polygon (windows on a wall, letters on a sign).
//!
//! Visibility asks only the base polygon, so details cost nothing where it is hidden and never fight with it for depth.
//! Lighting uses the detail: for a look-up the share of each detail in the pixel's footprint is found by exact clipping (E.
//! Catmull, "A hidden-surface algorithm with anti-aliasing", 1978), which is anti-aliasing without a resolution.
//!
//! ```text
//!  polygons --trapezoids--> convex pieces, topmost first --grid--.
//!  uv, footprint --> parallelogram --carve out each piece that lies in it--> share of each polygon; the rest: base
//! ```
//!
//! A [`SurfaceDetail`] lives in a plane: in the plane of a face ([`DetailPlane`]), or in that of texture coordinates. As a
//! texture among others it is a [`PolygonsTexture`].

mod clip;
mod grid;
mod texture;
mod trapezoids;

use glam::{DVec2, Vec2, Vec3};

use self::clip::{Convex, area, carve};
use self::grid::{Grid, bounds};
use self::trapezoids::{Piece, trapezoids};

pub use self::texture::PolygonsTexture;

/// A polygon on the base.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DetailPolygon {
    /// Closed outlines without repetition of the first corner, either way round: the polygon is what lies inside an odd number
    /// of them, so that holes are outlines, too. They must not cross themselves nor each other.
    pub outlines: Vec<Vec<Vec2>>,
    /// What it is made of: an index that only the caller interprets.
    pub material: u32,
    /// Polygons of higher priority cover those of lower; of equal ones the later covers the earlier.
    pub priority: i32,
}

/// Why polygons cannot be attached.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DetailError {
    /// An outline is no polygon.
    #[error("outline {outline} of detail polygon {polygon} has {corners} corners, but at least 3 are needed")]
    TooFewCorners {
        /// Index of the polygon.
        polygon: usize,
        /// Index of its outline.
        outline: usize,
        /// How many corners it has.
        corners: usize,
    },
    /// A coordinate is no number, or beyond 1e6.
    #[error(
        "corner {corner} of outline {outline} of detail polygon {polygon} is ({x}, {y}), but must lie within 1e6"
    )]
    Corner {
        /// Index of the polygon.
        polygon: usize,
        /// Index of its outline.
        outline: usize,
        /// Index of the corner.
        corner: usize,
        /// First coordinate.
        x: f32,
        /// Second coordinate.
        y: f32,
    },
    /// Outlines cross.
    #[error("the outlines of detail polygon {polygon} cross; cut it into polygons that do not")]
    Crossing {
        /// Index of the polygon.
        polygon: usize,
    },
}

/// A detail's share of a footprint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetailWeight {
    /// Index of the polygon, as given to [`SurfaceDetail::new`].
    pub polygon: u32,
    /// Its material.
    pub material: u32,
    /// Visible share of the footprint's area, above 0, at most 1.
    pub weight: f32,
}

/// What is seen within a footprint; all shares add up to one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DetailCoverage {
    /// The details, topmost first.
    pub details: Vec<DetailWeight>,
    /// The share in which the base itself is seen.
    pub base: f32,
}

impl DetailCoverage {
    /// The mean of values over the footprint: `of` gives that of a material, or of the base.
    pub fn mean<T>(&self, of: impl Fn(Option<u32>) -> T) -> T
    where
        T: std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
    {
        let base = of(None) * self.base;
        self.details.iter().fold(base, |sum, d| sum + of(Some(d.material)) * d.weight)
    }
}

/// Footprints with more small pieces than this in them are quartered: time is linear in the number of pieces then. Pieces that
/// are not small would come back in every quarter.
const MANY_PIECES: usize = 24;
/// Quartering ends here, whatever is left.
const DEEPEST: u32 = 12;
/// Coordinates that are accepted.
const FARTHEST: f32 = 1e6;

/// Polygons attached to a base, ready to be looked up.
#[derive(Clone, Debug, Default)]
pub struct SurfaceDetail {
    /// Convex pieces, those of topmost polygons first.
    pieces: Vec<Piece>,
    /// Polygon of each piece.
    owners: Vec<u32>,
    materials: Vec<u32>,
    grid: Grid,
}

impl SurfaceDetail {
    /// Prepares polygons. Outlines without area are allowed and cover nothing.
    ///
    /// # Errors
    ///
    /// An outline with too few corners, a coordinate out of range, or outlines that cross.
    pub fn new(polygons: &[DetailPolygon]) -> Result<Self, DetailError> {
        let mut order: Vec<usize> = (0..polygons.len()).collect();
        order.sort_by_key(|&p| std::cmp::Reverse((polygons[p].priority, p)));
        let (mut pieces, mut owners) = (Vec::new(), Vec::new());
        for polygon in order {
            let outlines = checked_outlines(polygon, &polygons[polygon])?;
            let own = trapezoids(&outlines).ok_or(DetailError::Crossing { polygon })?;
            owners.extend(std::iter::repeat_n(polygon as u32, own.len()));
            pieces.extend(own);
        }
        let grid = Grid::new(&pieces);
        Ok(Self { pieces, owners, materials: polygons.iter().map(|p| p.material).collect(), grid })
    }

    /// The shares of details in the parallelogram around `uv` whose sides are `footprint`. Without area it is the point `uv`.
    ///
    /// Time is linear in the number of pieces within the footprint; where many polygons lie over each other and each shows
    /// a little below the last, it grows with the square of their number.
    pub fn coverage(&self, uv: Vec2, footprint: [Vec2; 2]) -> DetailCoverage {
        let centre = uv.as_dvec2();
        let [mut side, other] = footprint.map(Vec2::as_dvec2);
        let full = side.perp_dot(other);
        if !(full.abs() > 1e-24 && full.is_finite() && centre.is_finite()) {
            return self.coverage_of_point(uv);
        }
        if full < 0.0 {
            // Counter-clockwise.
            side = -side;
        }
        let corner = centre - 0.5 * (side + other);
        let mut areas = Vec::new();
        self.add_areas(corner, [side, other], 0, &mut areas);
        areas.sort_unstable_by_key(|a: &(u32, f64)| a.0);
        let mut details: Vec<(u32, f64)> = Vec::new();
        for (piece, area) in areas {
            let polygon = self.owners[piece as usize];
            match details.last_mut().filter(|d| d.0 == polygon) {
                Some(last) => last.1 += area,
                None => details.push((polygon, area)),
            }
        }
        let covered: f64 = details.iter().map(|d| d.1).sum::<f64>() / full.abs();
        let weight = |area: f64| (area / full.abs() / covered.max(1.0)) as f32;
        let details = details.into_iter().map(|(polygon, area)| self.weight(polygon, weight(area)));
        DetailCoverage { details: details.collect(), base: (1.0 - covered).max(0.0) as f32 }
    }

    /// The material of each polygon, as given.
    pub fn materials(&self) -> impl Iterator<Item = u32> + '_ {
        self.materials.iter().copied()
    }

    /// The topmost polygon at a point; borders belong to either side.
    pub fn topmost(&self, uv: Vec2) -> Option<u32> {
        let p = uv.as_dvec2();
        let holds =
            |piece: &Piece| (0..4).all(|k| (piece[(k + 1) % 4] - piece[k]).perp_dot(p - piece[k]) >= 0.0);
        let candidates = self.grid.pieces_in([p, p]);
        let piece = candidates.into_iter().find(|&i| holds(&self.pieces[i as usize]))?;
        Some(self.owners[piece as usize])
    }

    fn coverage_of_point(&self, uv: Vec2) -> DetailCoverage {
        match self.topmost(uv) {
            Some(polygon) => DetailCoverage { details: vec![self.weight(polygon, 1.0)], base: 0.0 },
            None => DetailCoverage { details: Vec::new(), base: 1.0 },
        }
    }

    fn weight(&self, polygon: u32, weight: f32) -> DetailWeight {
        DetailWeight { polygon, material: self.materials[polygon as usize], weight }
    }

    /// Visible areas of pieces within the parallelogram at `corner`, as piece and area, in any order.
    fn add_areas(&self, corner: DVec2, [side, other]: [DVec2; 2], depth: u32, areas: &mut Vec<(u32, f64)>) {
        let parallelogram = [corner, corner + side, corner + side + other, corner + other];
        let box_of_all = bounds(&parallelogram);
        let mut near = self.grid.pieces_in(box_of_all);
        near.retain(|&i| touch(bounds(&self.pieces[i as usize]), box_of_all));
        let half_box = 0.5 * (box_of_all[1] - box_of_all[0]);
        let is_small = |&&i: &&u32| {
            let [low, high] = bounds(&self.pieces[i as usize]);
            (high - low).cmplt(half_box).all()
        };
        if depth < DEEPEST && near.iter().filter(is_small).count() > MANY_PIECES {
            let (half, other_half) = (0.5 * side, 0.5 * other);
            for start in [DVec2::ZERO, half, other_half, half + other_half] {
                self.add_areas(corner + start, [half, other_half], depth + 1, areas);
            }
            return;
        }
        // Pieces come topmost first; each takes what is left.
        let mut left: Vec<Convex> = vec![parallelogram.to_vec()];
        for index in near {
            let piece = &self.pieces[index as usize];
            let box_of_piece = bounds(piece);
            let mut still_left = Vec::with_capacity(left.len());
            let mut visible = 0.0;
            for convex in left {
                if touch(bounds(&convex), box_of_piece) {
                    visible += area(&carve(convex, piece, &mut still_left));
                } else {
                    still_left.push(convex);
                }
            }
            if visible > 0.0 {
                areas.push((index, visible));
            }
            left = still_left;
            if left.is_empty() {
                return;
            }
        }
    }
}

/// Whether two boxes have a point in common.
fn touch(a: [DVec2; 2], b: [DVec2; 2]) -> bool {
    a[0].cmple(b[1]).all() && b[0].cmple(a[1]).all()
}

fn checked_outlines(index: usize, polygon: &DetailPolygon) -> Result<Vec<Vec<DVec2>>, DetailError> {
    for (outline, corners) in polygon.outlines.iter().enumerate() {
        if corners.len() < 3 {
            return Err(DetailError::TooFewCorners { polygon: index, outline, corners: corners.len() });
        }
        let bad = corners.iter().position(|c| !(c.is_finite() && c.abs().max_element() <= FARTHEST));
        if let Some(corner) = bad {
            let Vec2 { x, y } = corners[corner];
            return Err(DetailError::Corner { polygon: index, outline, corner, x, y });
        }
    }
    Ok(polygon.outlines.iter().map(|o| o.iter().map(|c| c.as_dvec2()).collect()).collect())
}

/// Coordinates in the plane of a face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetailPlane {
    /// Where the coordinates are 0, 0.
    pub origin: Vec3,
    /// Unit vectors along which the first and the second coordinate grow by one per unit of length.
    pub axes: [Vec3; 2],
}

impl DetailPlane {
    /// The plane of a triangle: the origin at its first corner, the first axis towards the second, counter-clockwise.
    /// `None` for a triangle without area.
    pub fn of_triangle([a, b, c]: [Vec3; 3]) -> Option<Self> {
        let normal = (b - a).cross(c - a).try_normalize()?;
        let first = (b - a).try_normalize()?;
        Some(Self { origin: a, axes: [first, normal.cross(first)] })
    }

    /// Coordinates of a point, or of its projection onto the plane.
    pub fn uv(&self, position: Vec3) -> Vec2 {
        self.along(position - self.origin)
    }

    /// The footprint that steps in space make in the plane.
    pub fn footprint(&self, position_steps: [Vec3; 2]) -> [Vec2; 2] {
        position_steps.map(|step| self.along(step))
    }

    fn along(&self, v: Vec3) -> Vec2 {
        Vec2::from(self.axes.map(|axis| v.dot(axis)))
    }
}
