//! Choosing triangles to fill.

use std::collections::BTreeSet;

use crate::{ColorFill, FillSettings, Paint, Surface, SurfacePoint, Symmetry};

/// What a fill covers.
#[derive(Clone, Debug, PartialEq)]
pub enum FillArea {
    /// All there is.
    Everything,
    /// Triangles, ascending.
    Triangles(Vec<u32>),
    /// What looks, in a channel, like points of the surface do.
    Color {
        /// Index of the channel.
        channel: usize,
        /// The points.
        starts: Vec<SurfacePoint>,
        /// How alike, and whether anywhere.
        fill: ColorFill,
    },
}

impl FillArea {
    /// What a fill of settings covers with a paint, from a point and its copies; none where it needs a point and there is none.
    pub fn of(
        surface: &Surface,
        fill: FillSettings,
        paint: &Paint,
        start: Option<SurfacePoint>,
        symmetry: &Symmetry,
    ) -> Option<Self> {
        let channel = paint.channels.first()?.channel;
        let scope = match (fill, &paint.stencil) {
            // Nothing else can be covered.
            (FillSettings::Whole, Some(stencil)) => return Some(Self::Triangles(stencil.triangles(surface))),
            (FillSettings::Whole, None) => return Some(Self::Everything),
            (FillSettings::Connected, _) => FillScope::Connected,
            (FillSettings::Angle(degrees), _) => FillScope::Angle(degrees),
            (FillSettings::Color(fill), _) => {
                let starts = fill_starts(surface, start?, symmetry);
                return Some(Self::Color { channel, starts, fill });
            }
        };
        Some(Self::Triangles(fill_triangles_with(surface, start?, scope, symmetry)))
    }
}

/// How far a fill goes from where it starts.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum FillScope {
    /// The whole surface.
    Whole,
    /// What hangs together with the start through edges across which triangles continue each other (`fantex_mesh::continued`).
    Connected,
    /// The same, across edges that bend by at most so many degrees.
    Angle(f32),
}

/// Mesh units from where a copy of a fill's start falls to the surface, at most. (Models are about 2 mesh units wide.)
const COPY_REACH: f32 = 0.1;

/// The triangles of a fill and its copies, ascending.
pub fn fill_triangles_with(
    surface: &Surface,
    start: SurfacePoint,
    scope: FillScope,
    symmetry: &Symmetry,
) -> Vec<u32> {
    let starts = fill_starts(surface, start, symmetry);
    let mut all = BTreeSet::new();
    for start in starts {
        // What is filled already goes as far, seen from any of its triangles.
        if !all.contains(&start.triangle) {
            all.extend(fill_triangles(surface, start, scope));
        }
    }
    all.into_iter().collect()
}

/// Where a fill and its copies start.
pub fn fill_starts(surface: &Surface, start: SurfacePoint, symmetry: &Symmetry) -> Vec<SurfacePoint> {
    symmetry.places(surface, start, COPY_REACH).into_iter().flatten().collect()
}

/// The triangles of a fill, ascending.
pub fn fill_triangles(surface: &Surface, start: SurfacePoint, scope: FillScope) -> Vec<u32> {
    let least_cosine = match scope {
        FillScope::Whole => return (0..surface.mesh().triangles.len() as u32).collect(),
        FillScope::Connected => -2.0,
        FillScope::Angle(degrees) => f64::from(degrees).to_radians().cos() - 1e-9,
    };
    let mut chosen = vec![false; surface.mesh().triangles.len()];
    chosen[start.triangle as usize] = true;
    let mut waiting = vec![start.triangle];
    while let Some(triangle) = waiting.pop() {
        let normal = surface.facet_normal(triangle);
        for edge in 3 * triangle..3 * triangle + 3 {
            let Some(other) = surface.opposite(edge) else { continue };
            let neighbour = other / 3;
            if !chosen[neighbour as usize] && surface.facet_normal(neighbour).dot(normal) >= least_cosine {
                chosen[neighbour as usize] = true;
                waiting.push(neighbour);
            }
        }
    }
    (0u32..).zip(chosen).filter_map(|(triangle, is_chosen)| is_chosen.then_some(triangle)).collect()
}
