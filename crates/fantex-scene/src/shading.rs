//! What a picture shows of its surfaces.

use std::f32::consts::TAU;
use std::sync::LazyLock;

use glam::Vec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How attributes are interpolated over the screen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Interpolation {
    /// Perspective-correct: `u(P) = sum(l_i u_i / w_i) / sum(l_i / w_i)` with screen barycentrics `l_i`.
    #[default]
    Perspective,
    /// Linear over the screen, which is wrong and shows break lines along triangle edges. Triangles that reach behind
    /// the eye have no linear interpolation and keep the correct one.
    Affine,
}

/// Where materials are evaluated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ShadingRate {
    /// Once per pixel and visible triangle, in the middle of its visible samples (multi-sampling).
    #[default]
    PerPixel,
    /// At every sample (supersampling), with footprints as small as the samples are close.
    PerSample,
}

/// What a light map holds. Either is relative to a white, perfectly diffuse surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LightQuantity {
    /// What lights, sky and glowing surfaces reach the point directly.
    Direct,
    /// The share of the sky that is seen from the point, weighted by the cosine to the normal; lights do not matter.
    AmbientOcclusion,
    /// All light that arrives, after up to the given number of diffuse reflections.
    #[default]
    Full,
}

/// A lighting model, or one of the inputs of lighting as the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Shading {
    /// glTF 2.0 metallic-roughness: Lambert and GGX.
    #[default]
    MetallicRoughness,
    /// Blinn-Phong with ambient.
    BlinnPhong,
    /// The base colour.
    BaseColor,
    /// The shading normal, -1..1 shown as 0..1.
    Normal,
    /// Occlusion, roughness and metallic as red, green and blue.
    OcclusionRoughnessMetallic,
    /// Emitted light.
    Emission,
}

impl Shading {
    /// Whether lights make a difference.
    pub fn is_lit(self) -> bool {
        matches!(self, Self::MetallicRoughness | Self::BlinnPhong)
    }
}

// Total reflectance of microfacet lobes.

/// Nodes of the table of [`split_sum`] along each axis.
pub const SPLIT_SUM_NODES: usize = NODES;

const NODES: usize = 24;

/// Half vectors per node.
const SAMPLES: u32 = 512;

/// `[scale, bias]` per node, rows of equal roughness.
static TABLE: LazyLock<[[f32; 2]; NODES * NODES]> = LazyLock::new(|| {
    let node = |i: usize| i as f32 / (NODES - 1) as f32;
    let mut table = [[0.0; 2]; NODES * NODES];
    for (row, nodes) in table.chunks_exact_mut(NODES).enumerate() {
        let a2 = (node(row) * node(row)).max(1e-4).powi(2);
        let half_vectors: Vec<Vec3> = (0..SAMPLES).map(|i| half_vector(i, a2)).collect();
        for (column, value) in nodes.iter_mut().enumerate() {
            *value = integrate(&half_vectors, a2, node(column).max(1e-3));
        }
    }
    table
});

/// What [`split_sum`] interpolates, for those who do so at many points at once: scale and bias at equidistant nodes from 0 to
/// 1, rows of equal roughness.
pub fn split_sum_nodes() -> &'static [[f32; 2]; NODES * NODES] {
    &TABLE
}

/// Scale and bias of the mirror colour in the light that a GGX lobe of a perceptual roughness reflects to the eye from
/// surroundings of radiance one; `n_v` is the cosine at which it is seen. The second half of the split sum (B. Karis,
/// "Real Shading in Unreal Engine 4", 2013).
pub fn split_sum(roughness: f32, n_v: f32) -> [f32; 2] {
    let [row, column] = [roughness, n_v].map(|v| v.clamp(0.0, 1.0) * (NODES - 1) as f32);
    let [y, x] = [row, column].map(|c| (c as usize).min(NODES - 2));
    let [fy, fx] = [row - y as f32, column - x as f32];
    let at = |dy: usize, dx: usize| TABLE[(y + dy) * NODES + x + dx];
    [0, 1].map(|i| {
        let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
        lerp(lerp(at(0, 0)[i], at(0, 1)[i], fx), lerp(at(1, 0)[i], at(1, 1)[i], fx), fy)
    })
}

/// One of the half vectors that are drawn by the GGX density, around the normal z. `a2` is the fourth power of the perceptual roughness.
fn half_vector(i: u32, a2: f32) -> Vec3 {
    // The Hammersley point set.
    let (e0, e1) = ((i as f32 + 0.5) / SAMPLES as f32, i.reverse_bits() as f32 / 4_294_967_296.0);
    let z = ((1.0 - e1) / (1.0 + (a2 - 1.0) * e1)).sqrt();
    let r = (1.0 - z * z).max(0.0).sqrt();
    Vec3::new(r * (TAU * e0).cos(), r * (TAU * e0).sin(), z)
}

/// The rest of the reflectance as the half vectors' weights.
fn integrate(half_vectors: &[Vec3], a2: f32, n_v: f32) -> [f32; 2] {
    let v = Vec3::new((1.0 - n_v * n_v).sqrt(), 0.0, n_v);
    let [mut scale, mut bias] = [0.0; 2];
    for &h in half_vectors {
        let v_h = v.dot(h);
        let n_l = 2.0 * v_h * h.z - n_v;
        if n_l <= 0.0 || v_h <= 0.0 {
            continue;
        }
        let weight = 4.0 * smith_visibility(n_l, n_v, a2) * n_l * v_h / h.z;
        let fresnel = (1.0 - v_h).powi(5);
        scale += weight * (1.0 - fresnel);
        bias += weight * fresnel;
    }
    [scale, bias].map(|sum| sum / SAMPLES as f32)
}

/// Height-correlated Smith shadowing of GGX: `G / (4 (n.l) (n.v))` (E. Heitz 2014). `a2` is the fourth power of the
/// perceptual roughness.
pub fn smith_visibility(n_l: f32, n_v: f32, a2: f32) -> f32 {
    let towards_light = n_v * (n_l * n_l * (1.0 - a2) + a2).sqrt();
    let towards_eye = n_l * (n_v * n_v * (1.0 - a2) + a2).sqrt();
    0.5 / (towards_light + towards_eye)
}
