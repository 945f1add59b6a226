//! From a material and lights to the light that reaches the eye.

mod batch;

use std::f32::consts::PI;

use glam::Vec3;

use crate::Finish;
use crate::illumination::Illumination;
use crate::surface::MaterialSample;
use fantex_scene::{AmbientLight, MirrorView, Shading, smith_visibility, split_sum};

pub(crate) use self::batch::evaluate_all;

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
        Shading::MetallicRoughness | Shading::BlinnPhong if material.unlit => material.base_color,
        Shading::MetallicRoughness | Shading::BlinnPhong if let Some(finish) = finish => {
            finish.evaluate(material, to_eye, light)
        }
        Shading::MetallicRoughness => material.emission + metallic_roughness(material, to_eye, light),
        Shading::BlinnPhong => material.emission + blinn_phong(material, to_eye, light),
    }
}

/// Reflectance of dielectrics at normal incidence (refractive index 1.5).
pub(crate) const DIELECTRIC: f32 = 0.04;

/// Roughness below which highlights of a directional light would be smaller than any pixel.
const SMALLEST_ALPHA: f32 = 2e-3;

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
    /// Both parts together.
    pub(crate) fn sum(&self) -> Vec3 {
        self.diffuse + self.specular
    }

    /// Both parts dimmed.
    pub(crate) fn scaled(&self, factor: f32) -> Self {
        Self { diffuse: self.diffuse * factor, specular: self.specular * factor }
    }
}

/// The reflection of one point towards the eye.
pub(crate) struct Microfacets {
    n: Vec3,
    v: Vec3,
    n_v: f32,
    pub(crate) diffuse: Vec3,
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
pub(crate) fn squared_roughness(material: &MaterialSample) -> f32 {
    (material.roughness * material.roughness).clamp(SMALLEST_ALPHA, 1.0)
}

#[cfg(test)]
mod tests {
    use fantex_mesh::Mesh;

    use super::*;
    use crate::illumination::PreparedLights;
    use crate::{FlatShading, FlatSurface, Hit, Light, Lights, RenderOptions};

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
        let prepared = PreparedLights::new(lights, &mesh, &surface, &RenderOptions::default());
        let hit = Hit {
            triangle: 0,
            lambda: Vec3::X,
            dlambda_dx: Vec3::ZERO,
            dlambda_dy: Vec3::ZERO,
            front: true,
            to_eye,
        };
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
        let m = MaterialSample { unlit: true, base_color: Vec3::new(0.1, 0.2, 0.3), ..material(0.5, 0.5) };
        let c = lit(Shading::MetallicRoughness, &m, Vec3::Z, &Lights::default());
        assert_eq!(c, m.base_color);
    }
}
