//! Meshes whose large triangles are cut before they are covered.

use std::borrow::Cow;

use fantex_base::Result;
use fantex_cover::{CoverOptions, CoverStats, TexelBudget, build_cover_while};
use fantex_mesh::{Mesh, refine_at_bends};

/// Triangles that a mesh is cut into at most, unless it has more.
const MAX_TRIANGLES: u64 = 200_000;

/// The same for automatic cuts.
const MAX_TRIANGLES_AUTOMATIC: u64 = 80_000;

/// Meshes of more triangles are not cut by themselves.
const MAX_TRIANGLES_BEFORE: usize = 32_000;

/// Longest edges that automatic cuts try, texels. What is lost goes up and down with them, as tiles happen to fit; so all are tried.
const LONGEST_EDGES: [u32; 6] = [256, 128, 64, 32, 24, 16];

/// Texels that a triangle's bytes in an asset are worth: some 6 beside 2 per texel of a material with four channels.
const TRIANGLE_TEXELS: f64 = 3.0;

/// What automatic cuts must gain, decibels.
const MIN_GAIN: f64 = 0.3;

/// Models of more triangles than this whose longest sides have fewer texels than `MIN_SIDE_TEXELS`, on the mean over their area, have borders
/// that are thin enough.
const FEW_TRIANGLES: f64 = 8000.0;

const MIN_SIDE_TEXELS: f64 = 32.0;

/// Cuts that give fewer triangles than this, times those there are, change too little to be tried.
const MIN_GROWTH: f64 = 1.25;

/// Texels of a mesh with a budget.
pub(crate) fn budget_texels(mesh: &Mesh, budget: &TexelBudget) -> f64 {
    match budget {
        TexelBudget::Total(texels) => *texels as f64,
        TexelBudget::Density(density) => density.powi(2) * mesh.area(),
        TexelBudget::PerTriangle(densities) => {
            let of = |(t, density): (usize, &f32)| f64::from(*density).powi(2) * mesh.triangle_area(t);
            densities.iter().enumerate().map(of).sum()
        }
    }
}

/// How large triangles are cut before they are covered.
///
/// Tiles overlap by whole triangles: those of few large ones have wide, jagged borders, and what is bent at a corner of the model
/// stretches all that lies around it. Small triangles at the bends make borders thin. The surface and its shading stay as they are, and
/// so do the vertices, which come before those that cuts add.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LongestEdge {
    /// Cuts as far as it makes textures sharper than the same bytes spent on texels, and by at least 0.3 decibels; into at most 80 000
    /// triangles, and meshes of at most 32 000.
    #[default]
    Automatic,
    /// Cuts until edges that end at a bend are at most so many texels long, or twice as many and so on where these were more than 200 000
    /// triangles; 0 leaves the mesh as it is.
    Texels(u32),
}

impl LongestEdge {
    /// The mesh that is covered with such options; one fan per tile leaves it as it is.
    pub fn refined<'m>(self, mesh: &'m Mesh, options: &CoverOptions) -> Cow<'m, Mesh> {
        self.refined_while(mesh, options, &|_| true).unwrap_or(Cow::Borrowed(mesh))
    }

    /// As [`refined`](Self::refined), but ends soon once it is not wanted any more. `goes_on` is asked that and told how much of the
    /// covering is done, from 0 to 1: covers that are tried, and that of the mesh which is found, which comes afterwards.
    ///
    /// # Errors
    /// It is not wanted any more.
    pub(crate) fn refined_while<'m>(
        self,
        mesh: &'m Mesh,
        options: &CoverOptions,
        goes_on: &(dyn Fn(f32) -> bool + Sync),
    ) -> Result<Cow<'m, Mesh>> {
        if self.leaves_whole(mesh, options.tile) {
            return Ok(Cow::Borrowed(mesh));
        }
        let texels = budget_texels(mesh, &options.budget);
        let longest = longest_edge(mesh);
        let density = (texels / mesh.area()).sqrt();
        if !density.is_normal() {
            return Ok(Cow::Borrowed(mesh));
        }
        match self {
            Self::Automatic => automatic(mesh, texels, options, longest, goes_on),
            Self::Texels(edge) => {
                let most = MAX_TRIANGLES.max(mesh.triangles.len() as u64);
                let mut wanted = f64::from(edge) / density;
                while wanted < longest {
                    match refine_at_bends(mesh, wanted as f32, most) {
                        Ok(refined) => return Ok(Cow::Owned(refined)),
                        // Too many triangles, or too thin ones.
                        Err(_) => wanted *= 2.0,
                    }
                }
                Ok(Cow::Borrowed(mesh))
            }
        }
    }

    /// Whether a mesh stays as it is, however many texels it gets.
    pub(crate) fn leaves_whole(self, mesh: &Mesh, tile: u32) -> bool {
        tile == 0
            || match self {
                Self::Automatic => mesh.triangles.len() > MAX_TRIANGLES_BEFORE,
                Self::Texels(edge) => edge == 0,
            }
    }
}

/// Tries one length after the other, as long as the triangles alone do not cost more than the best. `longest`: the mesh's longest edge, mesh units.
fn automatic<'m>(
    mesh: &'m Mesh,
    texels: f64,
    &CoverOptions { tile, hard_edges, .. }: &CoverOptions,
    longest: f64,
    goes_on: &(dyn Fn(f32) -> bool + Sync),
) -> Result<Cow<'m, Mesh>> {
    let whole = Cow::Borrowed(mesh);
    let triangles = mesh.triangles.len() as f64;
    let density = (texels / mesh.area()).sqrt();
    let lengths = LONGEST_EDGES.into_iter().map(|edge| f64::from(edge) / density);
    let mut lengths = lengths.filter(|length| *length < longest).peekable();
    let has_thin_borders = triangles > FEW_TRIANGLES && mean_longest_side(mesh) * density < MIN_SIDE_TEXELS;
    if has_thin_borders || lengths.peek().is_none() {
        return Ok(whole);
    }
    // All that may be tried; then it is known how much there is to do.
    let mut most = (MIN_GROWTH * triangles) as usize;
    let cut = lengths.map_while(|length| refine_at_bends(mesh, length as f32, MAX_TRIANGLES_AUTOMATIC).ok());
    // Not those that cut no more than the one before, or too little.
    let cut = cut.filter(|refined| {
        let is_more = refined.triangles.len() > most;
        most = most.max(refined.triangles.len());
        is_more
    });
    let cut: Vec<Mesh> = cut.collect();
    if cut.is_empty() {
        return Ok(whole);
    }
    let all: f64 = triangles + cut.iter().map(|refined| refined.triangles.len() as f64).sum::<f64>();
    let with_result = all + all / (1 + cut.len()) as f64;
    let mut done = 0.0;

    let budget = TexelBudget::Total(texels as u64);
    let options = CoverOptions { budget, tile, hard_edges, ..CoverOptions::default() };
    let cost_of_bytes =
        |mesh: &Mesh| 20.0 * (1.0 + TRIANGLE_TEXELS * mesh.triangles.len() as f64 / texels).log10();
    // None for what cannot be covered, as its tiles were too long.
    let mut cost = |mesh: &Mesh| {
        let own = mesh.triangles.len() as f64;
        let goes_on = |share| goes_on(((done + own * f64::from(share)) / with_result) as f32);
        let covered = build_cover_while(mesh, &options, &goes_on);
        done += own;
        match covered {
            Ok((_, CoverStats { loss_db, .. })) => Ok(Some(loss_db + cost_of_bytes(mesh))),
            Err(error) if error.is_cancelled() => Err(error),
            Err(_) => Ok(None),
        }
    };
    // What cannot be covered as it is gains by any cuts.
    let limit = cost(mesh)?.map_or(f64::INFINITY, |cost| cost - MIN_GAIN);
    let mut best: Option<(f64, Mesh)> = None;
    for refined in cut {
        if cost_of_bytes(&refined) >= best.as_ref().map_or(limit, |(cost, _)| *cost) {
            break;
        }
        let Some(cost) = cost(&refined)? else { continue };
        if best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, refined));
        }
    }
    // Those that were not tried were left out.
    goes_on((all / with_result) as f32);
    Ok(match best {
        Some((cost, refined)) if cost < limit => Cow::Owned(refined),
        _ => whole,
    })
}

/// Mesh units.
fn longest_edge(mesh: &Mesh) -> f64 {
    (0..mesh.triangles.len()).map(|t| longest_side(mesh, t)).fold(0.0, f64::max)
}

/// The mean over the surface, mesh units.
fn mean_longest_side(mesh: &Mesh) -> f64 {
    let weighted = |t: usize| {
        let [a, b, c] = mesh.triangle_positions(t);
        0.5 * f64::from((b - a).cross(c - a).length()) * longest_side(mesh, t)
    };
    (0..mesh.triangles.len()).map(weighted).sum::<f64>() / mesh.area()
}

fn longest_side(mesh: &Mesh, triangle: usize) -> f64 {
    let [a, b, c] = mesh.triangle_positions(triangle);
    f64::from(a.distance(b).max(b.distance(c)).max(c.distance(a)))
}
