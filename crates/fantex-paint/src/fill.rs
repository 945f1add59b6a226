//! Choosing triangles to fill.

use std::collections::BTreeSet;

use crate::{Surface, SurfacePoint};

/// How far a fill goes from where it starts.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum FillScope {
    /// The whole surface.
    Whole,
    /// What hangs together with the start through edges of two triangles.
    Connected,
    /// The same, across edges that bend by at most so many degrees.
    Angle(f32),
}

/// The triangles of a fill, ascending.
pub fn fill_triangles(surface: &Surface, start: SurfacePoint, scope: FillScope) -> Vec<u32> {
    let least_cosine = match scope {
        FillScope::Whole => return (0..surface.mesh().triangles.len() as u32).collect(),
        FillScope::Connected => -2.0,
        FillScope::Angle(degrees) => f64::from(degrees).to_radians().cos() - 1e-9,
    };
    let mut chosen = BTreeSet::from([start.triangle]);
    let mut waiting = vec![start.triangle];
    while let Some(triangle) = waiting.pop() {
        let normal = surface.facet_normal(triangle);
        for edge in 3 * triangle..3 * triangle + 3 {
            let Some(other) = surface.opposite(edge) else { continue };
            let neighbour = other / 3;
            if surface.facet_normal(neighbour).dot(normal) >= least_cosine && chosen.insert(neighbour) {
                waiting.push(neighbour);
            }
        }
    }
    chosen.into_iter().collect()
}
