//! From a material and lights to the light that reaches the eye.

mod batch;

use std::f32::consts::PI;

use fantex_scene::{AmbientLight, MirrorView, Shading, smith_visibility, split_sum};
use fantex_texture::ColorRamp;
use fantex_texture::combine::CombineMode;
use fantex_texture::look::ColorUse;
use glam::{Vec3, Vec4};

use crate::illumination::Illumination;
pub(crate) use crate::shading::batch::evaluate_all;
use crate::surface::MaterialSample;

/// Linear RGB towards the eye. `to_eye` is a unit vector.
pub(crate) fn evaluate(
    shading: Shading,
    material: &MaterialSample,
    finish: Option<&Finish>,
    to_eye: Vec3,
    light: &Illumination,
) -> Vec3 {
    match shading {
        Shading::BaseColor => material.base_color,
        Shading::Normal => material.normal * 0.5 + 0.5,
        Shading::OcclusionRoughnessMetallic => {
            Vec3::new(material.occlusion, material.roughness, material.metallic)
        }
        Shading::Emission => material.emission,
        Shading::MetallicRoughness | Shading::BlinnPhong if let Some(finish) = finish => {
            finish.evaluate(material, to_eye, light)
        }
        Shading::MetallicRoughness | Shading::BlinnPhong if material.unlit => {
            material.own_light() + material.base_color
        }
        Shading::MetallicRoughness => material.own_light() + metallic_roughness(material, to_eye, light),
        Shading::BlinnPhong => material.own_light() + blinn_phong(material, to_eye, light),
    }
}

/// Reflectance of dielectrics at normal incidence (refractive index 1.5).
pub(crate) const DIELECTRIC: f32 = 0.04;

/// Roughness below which highlights of a directional light would be smaller than any pixel.
const MIN_ALPHA: f32 = 2e-3;

/// `L = r_a L_a + sum_j (r_d (n.l_j) + r_s (n.h_j)^m) L_j`, with the reflectances taken from the metallic-roughness
/// material: `r_d` the dielectric's colour, `m = 2 / alpha^2 - 2` the exponent of the Blinn-Phong lobe that is as wide as
/// a Beckmann lobe of slope `alpha` (B. Walter et al., 2007), `r_s` the mirror colour times `(m + 8) / 8`, so that a
/// sharper highlight is a brighter one (N. Hoffman, "Physically-Based Shading Models in Film and Game Production", 2010).
fn blinn_phong(material: &MaterialSample, to_eye: Vec3, light: &Illumination) -> Vec3 {
    let n = material.normal;
    let ambient_reflectance = material.base_color * material.occlusion;
    let diffuse = material.base_color * (1.0 - material.metallic);
    let mirror = Vec3::splat(DIELECTRIC).lerp(material.base_color, material.metallic);
    let alpha = squared_roughness(material);
    let shininess = (2.0 / (alpha * alpha) - 2.0).max(0.0);
    let specular = mirror * ((shininess + 8.0) / 8.0);
    let ambient = ambient_reflectance * light.ambient.diffuse(n);
    light.incoming(n).fold(ambient, |sum, lamp| {
        let l = lamp.to_light;
        let n_l = n.dot(l);
        if n_l <= 0.0 {
            return sum;
        }
        let n_h = n.dot((l + to_eye).normalize_or(n)).max(0.0);
        sum + (diffuse * n_l + specular * n_h.powf(shininess)) * (lamp.color * lamp.visibility)
    })
}

/// glTF 2.0, appendix B: a dielectric (Lambert under a Fresnel coat) mixed with a metal by `metallic`; GGX
/// microfacets (Walter et al. 2007), height-correlated Smith shadowing (E. Heitz 2014), Fresnel after C. Schlick (1994).
fn metallic_roughness(material: &MaterialSample, to_eye: Vec3, light: &Illumination) -> Vec3 {
    let lobe = Microfacets::new(material, to_eye, Vec3::ONE);
    let ambient = lobe.ambient(light.ambient).sum() * material.occlusion;
    light
        .incoming(material.normal)
        .fold(ambient, |sum, lamp| sum + lobe.reflected(lamp.to_light) * (lamp.color * lamp.visibility))
}

/// Light towards the eye, linear RGB, by the way it took.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reflected {
    pub(crate) diffuse: Vec3,
    pub(crate) specular: Vec3,
}

impl Reflected {
    pub(crate) fn sum(&self) -> Vec3 {
        self.diffuse + self.specular
    }

    /// Both parts dimmed.
    pub(crate) fn scaled(&self, factor: f32) -> Self {
        Self { diffuse: self.diffuse * factor, specular: self.specular * factor }
    }
}

struct Microfacets {
    n: Vec3,
    v: Vec3,
    n_v: f32,
    diffuse: Vec3,
    /// Mirror colour at normal incidence.
    f0: Vec3,
    /// Squared perceptual roughness.
    alpha: f32,
    perceptual_roughness: f32,
    normal_steps: [Vec3; 2],
}

impl Microfacets {
    /// `specular` is a factor of the dielectric's mirror colour.
    pub(crate) fn new(material: &MaterialSample, to_eye: Vec3, specular: Vec3) -> Self {
        let n = material.normal;
        Self {
            n,
            v: to_eye,
            // A bent normal may turn away from the eye; such points are seen as if edge-on.
            n_v: n.dot(to_eye).max(1e-3),
            diffuse: material.base_color * (1.0 - material.metallic),
            f0: (specular * DIELECTRIC).lerp(material.base_color, material.metallic),
            alpha: squared_roughness(material),
            perceptual_roughness: material.roughness,
            normal_steps: material.normal_steps,
        }
    }

    /// Light reflected per light of colour one from the unit direction `l`; `pi` times the BRDF times the cosine,
    /// since lights state what a white diffuse surface reflects.
    fn reflected(&self, l: Vec3) -> Vec3 {
        let n_l = self.n.dot(l);
        if n_l <= 0.0 {
            return Vec3::ZERO;
        }
        let (h, fresnel) = self.fresnel(l);
        let specular = fresnel * (PI * self.shape(h, n_l));
        let diffuse = self.diffuse * (Vec3::ONE - fresnel);
        (diffuse + specular) * n_l
    }

    /// The half vector towards the unit direction `l`, and the share of the light that facets across it mirror.
    pub(crate) fn fresnel(&self, l: Vec3) -> (Vec3, Vec3) {
        let h = (self.v + l).normalize_or(self.n);
        let v_h = self.v.dot(h).clamp(0.0, 1.0);
        (h, self.f0 + (Vec3::ONE - self.f0) * (1.0 - v_h).powi(5))
    }

    /// Density and shadowing of the facets across the half vector: `D G / (4 (n.l) (n.v))`.
    pub(crate) fn shape(&self, half: Vec3, n_l: f32) -> f32 {
        let n_h = self.n.dot(half).clamp(0.0, 1.0);
        self.distribution(n_h) * smith_visibility(n_l, self.n_v, self.alpha * self.alpha)
    }

    /// GGX density of facets along the half vector. `1 - c^2` is formed as `(1 - c)(1 + c)` to keep its digits.
    fn distribution(&self, n_h: f32) -> f32 {
        let a2 = self.alpha * self.alpha;
        let d = (1.0 - n_h) * (1.0 + n_h) + n_h * n_h * a2;
        a2 / (PI * d * d)
    }

    /// Reflection of the surroundings: the mean colour around the normal for the diffuse part, around the mirror
    /// direction for the specular part, times the lobe's total reflectance (B. Karis, "Real Shading in Unreal
    /// Engine 4", 2013: the split sum).
    pub(crate) fn ambient(&self, light: &AmbientLight) -> Reflected {
        let view = MirrorView::new(self.n, self.normal_steps, self.v);
        let [scale, bias] = split_sum(self.perceptual_roughness, self.n_v);
        let specular = self.f0 * scale + Vec3::splat(bias);
        let diffuse = self.diffuse * (Vec3::ONE - specular);
        Reflected {
            diffuse: diffuse * light.diffuse(self.n),
            specular: specular * light.specular(&view, self.perceptual_roughness),
        }
    }
}

/// The slope of the facets, from the perceptual roughness.
fn squared_roughness(material: &MaterialSample) -> f32 {
    (material.roughness * material.roughness).clamp(MIN_ALPHA, 1.0)
}

// What a material says beyond the core of glTF, and how it is lit.

/// The properties of a point beyond [`MaterialSample`]. A surface whose points have them states its own lighting model,
/// too, so that [`Shading::MetallicRoughness`](crate::Shading) and [`Shading::BlinnPhong`](crate::Shading) make no
/// difference to it.
#[derive(Clone, Copy, Debug)]
pub struct Finish<'a> {
    /// Whether light is reflected after Blinn and Phong; as metallic-roughness otherwise. Points that are
    /// [unlit](MaterialSample::unlit) reflect none.
    pub is_blinn_phong: bool,
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
    /// Replaces direct and ambient light of the diffuse part, and where it is below one, dims what is mirrored. Linear RGB.
    pub light_map: Option<Vec3>,
    /// Multiplied onto the lit colour at the end, linear RGB.
    pub modulate: Vec3,
    /// What the lit colour is combined with after that: the mode, `T` and `C`, linear RGBA.
    pub fragment: Option<(CombineMode, Vec4, Vec4)>,
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
            is_blinn_phong: false,
            color_use: ColorUse::APriori,
            ambient: Vec3::ONE,
            specular: Vec3::ONE,
            shininess: None,
            reflection: Vec3::ZERO,
            light_map: None,
            modulate: Vec3::ONE,
            fragment: None,
            toon: None,
            normal_width: 0.0,
            anisotropy: None,
        }
    }
}

/// Points at which a colour scale is asked to average it.
const RAMP_POINTS: usize = 8;

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
        !self.is_blinn_phong
            && self.color_use == ColorUse::APriori
            && self.specular == Vec3::ONE
            && self.light_map.is_none()
            && self.modulate == Vec3::ONE
            && self.fragment.is_none()
            && self.toon.is_none()
            && self.anisotropy.is_none()
    }

    /// Linear RGB towards the eye. `to_eye` is a unit vector.
    pub(crate) fn evaluate(&self, material: &MaterialSample, to_eye: Vec3, light: &Illumination) -> Vec3 {
        let base = material.base_color;
        let white = MaterialSample { base_color: Vec3::ONE, ..*material };
        let color = match self.color_use {
            _ if material.unlit => base * self.light_map.unwrap_or(Vec3::ONE),
            ColorUse::Replace => base,
            ColorUse::APriori => self.lit(material, to_eye, light),
            ColorUse::Modulate => base * self.lit(&white, to_eye, light),
        };
        let lit = material.own_light() + color * self.modulate;
        match self.fragment {
            None => lit,
            Some((mode, texel, constant)) => {
                mode.apply(texel, lit.extend(material.alpha), constant).truncate()
            }
        }
    }

    fn lit(&self, material: &MaterialSample, to_eye: Vec3, light: &Illumination) -> Vec3 {
        let reflected = if self.is_blinn_phong {
            self.blinn_phong(material, to_eye, light)
        } else {
            self.metallic_roughness(material, to_eye, light)
        };
        let diffuse_color = material.base_color * (1.0 - material.metallic);
        match self.light_map {
            None => reflected.diffuse + reflected.specular,
            // What no light reaches mirrors none.
            Some(light) => light * diffuse_color + light.clamp(Vec3::ZERO, Vec3::ONE) * reflected.specular,
        }
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

#[cfg(test)]
mod tests {
    use fantex_mesh::{Mesh, SurfacePoint};

    use crate::illumination::PreparedLights;
    use crate::{FlatShading, FlatSurface, Hit, Light, Lights, RenderOptions};

    use super::*;

    fn material(roughness: f32, metallic: f32) -> MaterialSample {
        MaterialSample { roughness, metallic, ..MaterialSample::with_normal(Vec3::Z) }
    }

    fn only(to_light: Vec3) -> Lights {
        Lights {
            ambient: AmbientLight::uniform(Vec3::ZERO),
            lamps: vec![Light::directional(to_light, Vec3::ONE)],
        }
    }

    fn lit(shading: Shading, material: &MaterialSample, to_eye: Vec3, lights: &Lights) -> Vec3 {
        let mesh = Mesh::default();
        let surface = FlatSurface::new(&mesh, FlatShading::Unlit, |_| Vec3::ONE);
        let prepared = PreparedLights::new(lights, &mesh, &surface, &RenderOptions::default()).unwrap();
        let hit = Hit { at: SurfacePoint::corner(0, 0), lambda_steps: [Vec3::ZERO; 2], front: true, to_eye };
        evaluate(shading, material, None, to_eye, &prepared.at(&mesh, &surface, &hit))
    }

    /// Directions spread evenly over the upper hemisphere.
    fn hemisphere(count: usize) -> impl Iterator<Item = Vec3> {
        (0..count).map(move |i| {
            let z = (i as f32 + 0.5) / count as f32;
            let angle = i as f32 * 2.399_963_2;
            let r = (1.0 - z * z).sqrt();
            Vec3::new(r * angle.cos(), r * angle.sin(), z)
        })
    }

    #[test]
    fn no_more_light_leaves_than_arrives() {
        // A white furnace: light of radiance one from everywhere is the mean over the hemisphere of twice the response.
        let to_eye = Vec3::new(0.6, 0.0, 0.8);
        for roughness in [0.3, 0.6, 1.0] {
            for metallic in [0.0, 1.0] {
                let m = material(roughness, metallic);
                let n = 20_000;
                let sum: f32 =
                    hemisphere(n).map(|l| lit(Shading::MetallicRoughness, &m, to_eye, &only(l)).x).sum();
                let total = 2.0 * sum / n as f32;
                assert!(total < 1.02 && total > 0.3, "roughness {roughness}, metallic {metallic}: {total}");
                if metallic == 1.0 {
                    let [scale, bias] = split_sum(roughness, to_eye.z);
                    assert!(
                        (total - scale - bias).abs() < 0.03,
                        "split sum {} against {total}",
                        scale + bias
                    );
                }
            }
        }
    }

    #[test]
    fn a_facing_white_diffuser_reflects_the_lights_colour() {
        let lit = lit(Shading::BlinnPhong, &material(1.0, 0.0), Vec3::X, &only(Vec3::Z));
        assert!((lit.x - 1.0 - DIELECTRIC).abs() < 1e-5, "{lit}");
    }

    #[test]
    fn highlights_sit_at_the_mirror_direction() {
        let m = material(0.2, 1.0);
        let to_eye = Vec3::new(0.6, 0.0, 0.8);
        for shading in [Shading::MetallicRoughness, Shading::BlinnPhong] {
            let at = |l: Vec3| lit(shading, &m, to_eye, &only(l)).x;
            let mirror = at(Vec3::new(-0.6, 0.0, 0.8));
            assert!(mirror > 4.0 * at(Vec3::new(0.0, 0.0, 1.0)), "{shading:?}");
            assert!(mirror > 4.0 * at(Vec3::new(0.6, 0.0, 0.8)), "{shading:?}");
        }
    }

    #[test]
    fn extreme_materials_give_numbers() {
        for roughness in [0.0, 1.0] {
            for metallic in [0.0, 1.0] {
                for to_eye in [Vec3::Z, Vec3::X, Vec3::NEG_Z] {
                    for l in [Vec3::Z, Vec3::X, Vec3::NEG_Z, Vec3::ZERO] {
                        for shading in [Shading::MetallicRoughness, Shading::BlinnPhong] {
                            let c = lit(shading, &material(roughness, metallic), to_eye, &only(l));
                            assert!(c.is_finite() && c.min_element() >= 0.0, "{shading:?} {to_eye} {l}: {c}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn unlit_surfaces_show_their_colour() {
        let base_color = Vec3::new(0.1, 0.2, 0.3);
        let m = MaterialSample { unlit: true, base_color, emission: Vec3::ONE, ..material(0.5, 0.5) };
        let c = lit(Shading::MetallicRoughness, &m, Vec3::Z, &Lights::default());
        assert_eq!(c, m.base_color);
    }
}
