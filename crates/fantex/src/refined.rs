//! Meshes whose large triangles are cut before they are covered.

use std::borrow::Cow;

use fantex_cover::{CoverOptions, CoverStats, TexelBudget, build_cover};
use fantex_mesh::{Mesh, refine_at_bends};

/// Triangles that a mesh is cut into at most, unless it has more.
const MAX_TRIANGLES: u64 = 200_000;

/// The same for automatic cuts.
const MAX_TRIANGLES_AUTOMATIC: u64 = 64_000;

/// Longest edges that automatic cuts try, texels.
const LONGEST_EDGES: [u32; 5] = [256, 128, 64, 32, 16];

/// Bytes of a triangle in an asset, beside one byte per texel.
const TRIANGLE_BYTES: f64 = 6.0;

/// What automatic cuts must gain, decibels.
const MIN_GAIN: f64 = 0.5;

/// How large triangles are cut before they are covered.
///
/// Tiles overlap by whole triangles: those of few large ones have wide, jagged borders, and what is bent at a corner of the model
/// stretches all that lies around it. Small triangles at the bends make borders thin. The surface and its shading stay as they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LongestEdge {
    /// Cuts as far as it makes textures sharper than the same bytes spent on texels, and by at least half a decibel; at most 64 000
    /// triangles.
    Automatic,
    /// Cuts until edges that end at a bend are at most so many texels long, or twice as many and so on where these were more than 200 000
    /// triangles; 0 leaves the mesh as it is.
    Texels(u32),
}

impl Default for LongestEdge {
    /// Triangles stay whole.
    fn default() -> Self {
        Self::Texels(0)
    }
}

impl LongestEdge {
    /// The mesh that is covered with about `texels` texels in tiles of at most `tile` texels; one fan per tile, 0, leaves it as it is.
    pub fn refined(self, mesh: &Mesh, texels: f64, tile: u32) -> Cow<'_, Mesh> {
        let longest = longest_edge(mesh);
        let density = (texels / mesh.area()).sqrt();
        if tile == 0 || !density.is_normal() {
            return Cow::Borrowed(mesh);
        }
        match self {
            Self::Automatic => automatic(mesh, texels, tile, longest * density),
            Self::Texels(0) => Cow::Borrowed(mesh),
            Self::Texels(edge) => {
                let most = MAX_TRIANGLES.max(mesh.triangles.len() as u64);
                let mut wanted = f64::from(edge) / density;
                while wanted < longest {
                    match refine_at_bends(mesh, wanted as f32, most) {
                        Ok(refined) => return Cow::Owned(refined),
                        // Too many triangles, or too thin ones.
                        Err(_) => wanted *= 2.0,
                    }
                }
                Cow::Borrowed(mesh)
            }
        }
    }
}

/// `longest`: the mesh's longest edge, texels.
fn automatic(mesh: &Mesh, texels: f64, tile: u32, longest: f64) -> Cow<'_, Mesh> {
    let whole = Cow::Borrowed(mesh);
    let edges = LONGEST_EDGES.into_iter().map(f64::from).filter(|edge| *edge < longest);
    if 2 * mesh.triangles.len() as u64 > MAX_TRIANGLES_AUTOMATIC || edges.clone().next().is_none() {
        return whole;
    }
    let budget = TexelBudget::Total(texels as u64);
    let options = CoverOptions { budget, tile, ..CoverOptions::default() };
    let cost = |mesh: &Mesh| {
        let (_, CoverStats { loss_db, .. }) = build_cover(mesh, &options).ok()?;
        let bytes = texels + TRIANGLE_BYTES * mesh.triangles.len() as f64;
        Some(loss_db + 20.0 * (bytes / texels).log10())
    };
    let Some(cost_of_whole) = cost(mesh) else { return whole };
    let mut best = (cost_of_whole - MIN_GAIN, whole);
    for edge in edges {
        if best.0 <= 0.0 {
            break;
        }
        let edge = (edge / longest) as f32 * longest_edge(mesh) as f32;
        let Ok(refined) = refine_at_bends(mesh, edge, MAX_TRIANGLES_AUTOMATIC) else { break };
        if let Some(cost) = cost(&refined).filter(|cost| *cost < best.0) {
            best = (cost, Cow::Owned(refined));
        }
    }
    best.1
}

/// Mesh units.
fn longest_edge(mesh: &Mesh) -> f64 {
    let longest = |t: usize| -> f32 {
        let [a, b, c] = mesh.triangle_positions(t);
        a.distance(b).max(b.distance(c)).max(c.distance(a))
    };
    f64::from((0..mesh.triangles.len()).map(longest).fold(0.0, f32::max))
}
