//! What a material says beyond the core of glTF, and how it is lit.

use std::f32::consts::PI;

use fantex_texture::ColorRamp;
use fantex_texture::look::{ColorUse, LightingModel};
use glam::Vec3;

use crate::illumination::Illumination;
use crate::shading::{DIELECTRIC, Microfacets, Reflected, squared_roughness};
use crate::surface::MaterialSample;
use fantex_scene::MirrorView;

/// The properties of a point beyond [`MaterialSample`]. A surface whose points have them states its own lighting model,
/// too, so that [`Shading::MetallicRoughness`](crate::Shading) and [`Shading::BlinnPhong`](crate::Shading) make no
/// difference to it.
#[derive(Clone, Copy, Debug)]
pub struct Finish<'a> {
    /// How light is reflected.
    pub lighting: LightingModel,
    /// What the base colour does to the lighting.
    pub color_use: ColorUse,
    /// Blinn-Phong: ambient reflectance, a factor of the base colour, linear RGB.
    pub ambient: Vec3,
    /// Blinn-Phong: specular reflectance; metallic-roughness: factor of the dielectric's highlight. Linear RGB.
    pub specular: Vec3,
    /// Blinn-Phong: exponent; without, it follows from the roughness and the highlight's height from the exponent.
    pub shininess: Option<f32>,
    /// Share of the mirrored surroundings that Blinn-Phong adds, linear RGB.
    pub reflection: Vec3,
    /// Replaces direct and ambient light of the diffuse part, linear RGB.
    pub light_map: Option<Vec3>,
    /// Multiplied onto the lit colour at the end, linear RGB.
    pub modulate: Vec3,
    /// The diffuse light of each lamp by its `n.l`.
    pub toon: Option<&'a ColorRamp>,
    /// By how much the normal turns within the pixel, radians: borders of the toon scale are averaged over it.
    pub normal_width: f32,
    /// A highlight that depends on a direction in the surface.
    pub anisotropy: Option<AnisotropySample>,
}

/// The anisotropy of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnisotropySample {
    /// Along which the highlight is stretched: a unit vector in the surface, mesh space.
    pub direction: Vec3,
    /// -1..1; negative where it is stretched across the direction.
    pub strength: f32,
}

impl Default for Finish<'_> {
    /// What a material without a finish looks like.
    fn default() -> Self {
        Self {
            lighting: LightingModel::MetallicRoughness,
            color_use: ColorUse::APriori,
            ambient: Vec3::ONE,
            specular: Vec3::ONE,
            shininess: None,
            reflection: Vec3::ZERO,
            light_map: None,
            modulate: Vec3::ONE,
            toon: None,
            normal_width: 0.0,
            anisotropy: None,
        }
    }
}

/// Points at which a colour scale is asked to average it.
const RAMP_POINTS: usize = 8;

/// The mean colour of a scale over a stretch around `index`.
fn mean_color(ramp: &ColorRamp, index: f32, width: f32) -> Vec3 {
    if width < 1e-4 {
        return ramp.color(index).truncate();
    }
    let at = |i: usize| ramp.color(index + width * ((i as f32 + 0.5) / RAMP_POINTS as f32 - 0.5)).truncate();
    (0..RAMP_POINTS).map(at).sum::<Vec3>() / RAMP_POINTS as f32
}

impl Finish<'_> {
    /// Whether the point is lit as if it had no finish, under [`Shading::MetallicRoughness`](crate::Shading).
    pub(crate) fn is_plain(&self) -> bool {
        self.lighting == LightingModel::MetallicRoughness
            && self.color_use == ColorUse::APriori
            && self.specular == Vec3::ONE
            && self.light_map.is_none()
            && self.modulate == Vec3::ONE
            && self.toon.is_none()
            && self.anisotropy.is_none()
    }

    /// Linear RGB towards the eye. `to_eye` is a unit vector.
    pub(crate) fn evaluate(&self, material: &MaterialSample, to_eye: Vec3, light: &Illumination) -> Vec3 {
        let base = material.base_color;
        let white = MaterialSample { base_color: Vec3::ONE, ..*material };
        let color = match (self.lighting, self.color_use) {
            (LightingModel::Unlit, _) | (_, ColorUse::Replace) => base,
            (_, ColorUse::APriori) => self.lit(material, to_eye, light),
            (_, ColorUse::Modulate) => base * self.lit(&white, to_eye, light),
        };
        material.emission + color * self.modulate
    }

    fn lit(&self, material: &MaterialSample, to_eye: Vec3, light: &Illumination) -> Vec3 {
        let reflected = match self.lighting {
            LightingModel::BlinnPhong => self.blinn_phong(material, to_eye, light),
            _ => self.metallic_roughness(material, to_eye, light),
        };
        let diffuse_color = material.base_color * (1.0 - material.metallic);
        let diffuse = self.light_map.map_or(reflected.diffuse, |arriving| arriving * diffuse_color);
        diffuse + reflected.specular
    }

    /// What a lamp's `n.l` (negative below the horizon) contributes to diffuse reflection.
    fn diffuse_response(&self, n_l: f32, visibility: f32) -> Vec3 {
        match self.toon {
            // A shadow lowers the index, so that its border is a border of the scale's, too.
            Some(ramp) => {
                let index = if n_l > 0.0 { n_l * visibility } else { n_l };
                mean_color(ramp, index, self.normal_width * (1.0 - n_l * n_l).max(0.0).sqrt())
            }
            None => Vec3::splat(n_l.max(0.0) * visibility),
        }
    }

    /// `L = r_a L_a + sum_j (r_d (n.l_j) + r_s (n.h_j)^m) L_j`, exactly so where the exponent is stated. Toon scales cut
    /// the highlight by its own height.
    fn blinn_phong(&self, material: &MaterialSample, to_eye: Vec3, light: &Illumination) -> Reflected {
        let n = material.normal;
        let (specular, shininess) = self.phong_highlight(material);
        let axes = self.anisotropy.map(|a| HighlightAxes::new(n, &a, (2.0 / shininess.max(0.1)).sqrt()));
        let diffuse_color = material.base_color * (1.0 - material.metallic);
        let ambient = material.base_color * self.ambient * material.occlusion;
        let mirror = MirrorView::new(n, material.normal_steps, to_eye);
        let mut sum = Reflected {
            diffuse: ambient * light.ambient.diffuse(n),
            specular: self.reflection * light.ambient.specular(&mirror, 0.0),
        };
        for lamp in light.incoming(n) {
            let n_l = n.dot(lamp.to_light);
            sum.diffuse += diffuse_color * self.diffuse_response(n_l, lamp.visibility) * lamp.color;
            if n_l <= 0.0 {
                continue;
            }
            let half = (lamp.to_light + to_eye).normalize_or(n);
            let height = match &axes {
                Some(axes) => axes.ward(half),
                None => n.dot(half).max(0.0).powf(shininess),
            };
            let height = match self.toon {
                Some(ramp) => {
                    // The slope of the cosine's power, at the angle where it has this height.
                    let sine = (1.0 - n.dot(half).powi(2)).max(0.0).sqrt();
                    let width = self.normal_width * shininess * height * sine;
                    (mean_color(ramp, height, width) - ramp.color(0.0).truncate()).max(Vec3::ZERO)
                }
                None => Vec3::splat(height),
            };
            sum.specular += specular * height * (lamp.color * lamp.visibility);
        }
        sum
    }

    /// Specular reflectance and exponent.
    fn phong_highlight(&self, material: &MaterialSample) -> (Vec3, f32) {
        if let Some(shininess) = self.shininess {
            return (self.specular, shininess.max(0.0));
        }
        let alpha = squared_roughness(material);
        let shininess = (2.0 / (alpha * alpha) - 2.0).max(0.0);
        let mirror = (Vec3::splat(DIELECTRIC) * self.specular).lerp(material.base_color, material.metallic);
        (mirror * ((shininess + 8.0) / 8.0), shininess)
    }

    fn metallic_roughness(&self, material: &MaterialSample, to_eye: Vec3, light: &Illumination) -> Reflected {
        let lobe = Microfacets::new(material, to_eye, self.specular);
        let axes =
            self.anisotropy.map(|a| HighlightAxes::new(material.normal, &a, squared_roughness(material)));
        let mut sum = lobe.ambient(light.ambient).scaled(material.occlusion);
        for lamp in light.incoming(material.normal) {
            let n_l = material.normal.dot(lamp.to_light);
            let (half, fresnel) = lobe.fresnel(lamp.to_light);
            let response = self.diffuse_response(n_l, lamp.visibility);
            sum.diffuse += lobe.diffuse * (Vec3::ONE - fresnel) * response * lamp.color;
            if n_l <= 0.0 {
                continue;
            }
            let shape = match &axes {
                Some(axes) => axes.ggx(half, lamp.to_light, to_eye),
                None => lobe.shape(half, n_l),
            };
            sum.specular += fresnel * (PI * shape * n_l * lamp.visibility) * lamp.color;
        }
        sum
    }
}

/// An anisotropic highlight's axes, orthonormal, and its width along them.
#[derive(Clone, Copy, Debug)]
struct HighlightAxes {
    tangent: Vec3,
    bitangent: Vec3,
    normal: Vec3,
    /// Slopes along tangent and bitangent.
    alpha: [f32; 2],
}

impl HighlightAxes {
    /// Stretches an isotropic width: `alpha / aspect` along and `alpha aspect` across the direction, with
    /// `aspect = sqrt(1 - 0.9 strength)` (B. Burley, "Physically-Based Shading at Disney", 2012).
    fn new(normal: Vec3, anisotropy: &AnisotropySample, alpha: f32) -> Self {
        let across = normal.cross(anisotropy.direction);
        let bitangent = across.try_normalize().unwrap_or_else(|| normal.any_orthonormal_vector());
        let aspect = (1.0 - 0.9 * anisotropy.strength.abs().min(1.0)).sqrt();
        let wide_narrow = [alpha / aspect, alpha * aspect].map(|a| a.clamp(1e-3, 1.0));
        let alpha = if anisotropy.strength >= 0.0 { wide_narrow } else { [wide_narrow[1], wide_narrow[0]] };
        Self { tangent: bitangent.cross(normal), bitangent, normal, alpha }
    }

    fn local(&self, v: Vec3) -> Vec3 {
        Vec3::new(v.dot(self.tangent), v.dot(self.bitangent), v.dot(self.normal))
    }

    /// The height of the highlight, one at its middle: the exponential of G. Ward, "Measuring and Modeling Anisotropic
    /// Reflection", 1992. With equal widths `sqrt(2 / m)` it is close to `(n.h)^m`.
    fn ward(&self, half: Vec3) -> f32 {
        let h = self.local(half);
        let [x, y] = [h.x / self.alpha[0], h.y / self.alpha[1]];
        if h.z <= 0.0 { 0.0 } else { (-(x * x + y * y) / (h.z * h.z)).exp() }
    }

    /// Density and shadowing of anisotropic GGX facets, `D G / (4 (n.l) (n.v))` (E. Heitz, "Understanding the
    /// Masking-Shadowing Function in Microfacet-Based BRDFs", 2014).
    fn ggx(&self, half: Vec3, to_light: Vec3, to_eye: Vec3) -> f32 {
        let [ax, ay] = self.alpha;
        let [h, l, v] = [half, to_light, to_eye].map(|w| self.local(w));
        let d = (h.x / ax).powi(2) + (h.y / ay).powi(2) + h.z * h.z;
        let distribution = 1.0 / (PI * ax * ay * d * d);
        let stretched = |w: Vec3| Vec3::new(ax * w.x, ay * w.y, w.z).length();
        let (n_l, n_v) = (l.z.max(1e-3), v.z.max(1e-3));
        distribution * 0.5 / (n_l * stretched(v) + n_v * stretched(l))
    }
}
