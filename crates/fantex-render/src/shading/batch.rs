//! The light of many points at once, in vectors, where all lamps are infinitely far away, cast no shadows, and the
//! surroundings are two colours: what most pictures of models have. Every step is that of the scalar path in the same order.

use std::f32::consts::PI;

use fantex_base::vector_level;
use fantex_scene::{AmbientLight, SPLIT_SUM_NODES, Shading, split_sum_nodes};
use fearless_simd::prelude::*;
use fearless_simd::{Select, Simd, dispatch};
use glam::Vec3;

use crate::hit::HitFinder;
use crate::illumination::{DistantLamp, PreparedLights};
use crate::shading::{DIELECTRIC, MIN_ALPHA, evaluate};
use crate::vectors::{Vector, add, clamped, dot, lerp, mul, normalize_or, scaled, splat, sub};
use crate::{Finish, Hit, MaterialSample, Shaded, Surface};

/// Points of a block; a whole number of vectors.
const BLOCK: usize = 64;

/// One number of every point of a block.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Numbers([f32; BLOCK]);

/// A vector of every point of a block.
type Vectors = [Numbers; 3];

const ZERO: Numbers = Numbers([0.0; BLOCK]);

struct Points {
    normal: Vectors,
    to_eye: Vectors,
    base_color: Vectors,
    /// What is there without lamps and surroundings.
    own_light: Vectors,
    occlusion: Numbers,
    roughness: Numbers,
    metallic: Numbers,
    /// Towards the eye: what is worked out.
    light: Vectors,
}

impl Points {
    fn new() -> Self {
        let zeros = [ZERO; 3];
        Self {
            normal: zeros,
            to_eye: zeros,
            base_color: zeros,
            own_light: zeros,
            occlusion: ZERO,
            roughness: ZERO,
            metallic: ZERO,
            light: zeros,
        }
    }

    fn set(&mut self, index: usize, material: &MaterialSample, to_eye: Vec3) {
        set(&mut self.normal, index, material.normal);
        set(&mut self.to_eye, index, to_eye);
        set(&mut self.base_color, index, material.base_color);
        set(&mut self.own_light, index, material.own_light());
        self.occlusion.0[index] = material.occlusion;
        self.roughness.0[index] = material.roughness;
        self.metallic.0[index] = material.metallic;
    }

    fn light(&self, index: usize) -> Vec3 {
        let [r, g, b] = &self.light;
        Vec3::new(r.0[index], g.0[index], b.0[index])
    }
}

fn set(vectors: &mut Vectors, index: usize, value: Vec3) {
    let [x, y, z] = vectors;
    (x.0[index], y.0[index], z.0[index]) = (value.x, value.y, value.z);
}

/// [`evaluate`] at many points: appends linear RGB towards the eye.
pub(crate) fn evaluate_all(
    shading: Shading,
    (hits, materials): (&[Hit], &[Shaded<'_>]),
    finder: &HitFinder<'_>,
    surface: &dyn Surface,
    lights: &PreparedLights<'_>,
    out: &mut Vec<Vec3>,
) {
    let one = |hit: &Hit, (material, finish): &Shaded<'_>| {
        let arriving = lights.at(finder.mesh, surface, hit);
        evaluate(shading, material, finish.as_ref(), hit.to_eye, &arriving)
    };
    let Some(lamps) = lights.distant().filter(|_| shading == Shading::MetallicRoughness) else {
        out.extend(hits.iter().zip(materials).map(|(hit, material)| one(hit, material)));
        return;
    };
    let mut points = Points::new();
    for (hits, materials) in hits.chunks(BLOCK).zip(materials.chunks(BLOCK)) {
        for (index, (hit, (material, _))) in hits.iter().zip(materials).enumerate() {
            points.set(index, material, hit.to_eye);
        }
        let count = hits.len();
        dispatch!(vector_level(), simd => metallic_roughness(simd, &mut points, lights.ambient, lamps, count));
        out.extend(hits.iter().zip(materials).enumerate().map(|(index, (hit, shaded))| {
            let (material, finish) = shaded;
            let is_plain = finish.as_ref().is_none_or(Finish::is_plain);
            if material.unlit || !is_plain { one(hit, shaded) } else { points.light(index) }
        }));
    }
}

#[inline(always)]
fn load<S: Simd>(simd: S, numbers: &Numbers, first: usize) -> S::f32s {
    S::f32s::from_slice(simd, &numbers.0[first..first + S::f32s::LEN])
}

#[inline(always)]
fn load_vector<S: Simd>(simd: S, vectors: &Vectors, first: usize) -> Vector<S::f32s> {
    [load(simd, &vectors[0], first), load(simd, &vectors[1], first), load(simd, &vectors[2], first)]
}

/// As the scalar function of that name, with the point's own light.
#[expect(clippy::needless_range_loop, reason = "counted loops are unrolled, which keeps arrays in registers")]
#[inline(always)]
fn metallic_roughness<S: Simd>(
    simd: S,
    points: &mut Points,
    ambient: &AmbientLight,
    lamps: &[DistantLamp],
    count: usize,
) {
    for first in (0..count).step_by(S::f32s::LEN) {
        let lobe = Lobe::new(simd, points, first);
        let occlusion = load(simd, &points.occlusion, first);
        let mut sum = scaled::<S>(lobe.ambient(simd, ambient), occlusion);
        for lamp in lamps {
            let reflected = lobe.reflected(simd, splat(simd, lamp.to_light));
            sum = add::<S>(sum, mul::<S>(reflected, splat(simd, lamp.color)));
        }
        let light = add::<S>(load_vector(simd, &points.own_light, first), sum);
        for axis in 0..3 {
            light[axis].store_slice(&mut points.light[axis].0[first..first + S::f32s::LEN]);
        }
    }
}

/// As [`Microfacets`](super::Microfacets).
struct Lobe<S: Simd> {
    n: Vector<S::f32s>,
    v: Vector<S::f32s>,
    n_v: S::f32s,
    diffuse: Vector<S::f32s>,
    f0: Vector<S::f32s>,
    alpha: S::f32s,
    perceptual_roughness: S::f32s,
}

impl<S: Simd> Lobe<S> {
    #[inline(always)]
    fn new(simd: S, points: &Points, first: usize) -> Self {
        let n = load_vector(simd, &points.normal, first);
        let v = load_vector(simd, &points.to_eye, first);
        let base_color = load_vector(simd, &points.base_color, first);
        let roughness = load(simd, &points.roughness, first);
        let metallic = load(simd, &points.metallic, first);
        let dielectric = splat(simd, Vec3::ONE * DIELECTRIC);
        Self {
            n,
            v,
            n_v: dot::<S>(n, v).max(S::f32s::splat(simd, 1e-3)),
            diffuse: scaled::<S>(base_color, S::f32s::splat(simd, 1.0) - metallic),
            f0: lerp(simd, dielectric, base_color, metallic),
            alpha: clamped(simd, roughness * roughness, MIN_ALPHA, 1.0),
            perceptual_roughness: roughness,
        }
    }

    /// Both parts together.
    #[inline(always)]
    fn ambient(&self, simd: S, light: &AmbientLight) -> Vector<S::f32s> {
        let one = splat(simd, Vec3::ONE);
        let two_cosines = S::f32s::splat(simd, 2.0) * dot::<S>(self.n, self.v);
        let mirrored = sub::<S>(scaled::<S>(self.n, two_cosines), self.v);
        let roughness = self.perceptual_roughness;
        let share = clamped(simd, roughness * roughness, 0.0, 1.0);
        let middle = normalize_or(simd, lerp(simd, mirrored, self.n, share), self.n);
        let [scale, bias] = split_sum(simd, roughness, self.n_v);
        let specular = add::<S>(scaled::<S>(self.f0, scale), [bias; 3]);
        let diffuse = mul::<S>(self.diffuse, sub::<S>(one, specular));
        add::<S>(
            mul::<S>(diffuse, radiance(simd, light, self.n)),
            mul::<S>(specular, radiance(simd, light, middle)),
        )
    }

    #[inline(always)]
    fn reflected(&self, simd: S, l: Vector<S::f32s>) -> Vector<S::f32s> {
        let (zero, one) = (S::f32s::splat(simd, 0.0), S::f32s::splat(simd, 1.0));
        let n_l = dot::<S>(self.n, l);
        let half = normalize_or(simd, add::<S>(self.v, l), self.n);
        let beside = one - clamped(simd, dot::<S>(self.v, half), 0.0, 1.0);
        let squared = beside * beside;
        let fifth = squared * squared * beside;
        let ones = [one; 3];
        let fresnel = add::<S>(self.f0, scaled::<S>(sub::<S>(ones, self.f0), fifth));
        let a2 = self.alpha * self.alpha;
        let n_h = clamped(simd, dot::<S>(self.n, half), 0.0, 1.0);
        let d = (one - n_h) * (one + n_h) + n_h * n_h * a2;
        let distribution = a2 / (d * PI * d);
        let shape = distribution * smith_visibility(simd, n_l, self.n_v, a2);
        let specular = scaled::<S>(fresnel, shape * PI);
        let diffuse = mul::<S>(self.diffuse, sub::<S>(ones, fresnel));
        let light = scaled::<S>(add::<S>(diffuse, specular), n_l);
        let is_above = n_l.simd_gt(zero);
        [is_above.select(light[0], zero), is_above.select(light[1], zero), is_above.select(light[2], zero)]
    }
}

/// As [`fantex_scene::smith_visibility`].
#[inline(always)]
fn smith_visibility<S: Simd>(simd: S, n_l: S::f32s, n_v: S::f32s, a2: S::f32s) -> S::f32s {
    let rest = S::f32s::splat(simd, 1.0) - a2;
    let towards_light = n_v * (n_l * n_l * rest + a2).sqrt();
    let towards_eye = n_l * (n_v * n_v * rest + a2).sqrt();
    S::f32s::splat(simd, 0.5) / (towards_light + towards_eye)
}

/// As [`AmbientLight::radiance_from`].
#[inline(always)]
fn radiance<S: Simd>(simd: S, light: &AmbientLight, direction: Vector<S::f32s>) -> Vector<S::f32s> {
    let share = dot::<S>(direction, splat(simd, light.up)) * 0.5 + 0.5;
    lerp(simd, splat(simd, light.ground), splat(simd, light.sky), share)
}

/// As [`fantex_scene::split_sum`].
#[inline(always)]
fn split_sum<S: Simd>(simd: S, roughness: S::f32s, n_v: S::f32s) -> [S::f32s; 2] {
    const LAST: f32 = (SPLIT_SUM_NODES - 1) as f32;
    let row = clamped(simd, roughness, 0.0, 1.0) * LAST;
    let column = clamped(simd, n_v, 0.0, 1.0) * LAST;
    let inner = SPLIT_SUM_NODES as u32 - 2;
    let y = row.to_int::<S::u32s>().min(inner);
    let x = column.to_int::<S::u32s>().min(inner);
    let (fy, fx) = (row - y.to_float::<S::f32s>(), column - x.to_float::<S::f32s>());
    let mut nodes = [0; 16];
    (y * SPLIT_SUM_NODES as u32 + x).store_slice(&mut nodes[..S::u32s::LEN]);
    // Scale and bias at four nodes.
    let mut around = [[0.0; 16]; 8];
    let table = split_sum_nodes();
    for (lane, &node) in nodes[..S::u32s::LEN].iter().enumerate() {
        let node = node as usize;
        let corners = [node, node + 1, node + SPLIT_SUM_NODES, node + SPLIT_SUM_NODES + 1];
        for (corner, &at) in corners.iter().enumerate() {
            let [scale, bias] = table[at];
            (around[corner][lane], around[4 + corner][lane]) = (scale, bias);
        }
    }
    [between::<S>(simd, &around[..4], fx, fy), between::<S>(simd, &around[4..], fx, fy)]
}

#[inline(always)]
fn between<S: Simd>(simd: S, around: &[[f32; 16]], fx: S::f32s, fy: S::f32s) -> S::f32s {
    let a = S::f32s::from_slice(simd, &around[0][..S::f32s::LEN]);
    let b = S::f32s::from_slice(simd, &around[1][..S::f32s::LEN]);
    let c = S::f32s::from_slice(simd, &around[2][..S::f32s::LEN]);
    let d = S::f32s::from_slice(simd, &around[3][..S::f32s::LEN]);
    let upper = a + (b - a) * fx;
    upper + (c + (d - c) * fx - upper) * fy
}

#[cfg(test)]
mod tests {
    use fantex_mesh::{Mesh, SurfacePoint};
    use fantex_scene::{Camera, Projection};
    use glam::DVec3;

    use crate::{FlatShading, FlatSurface, Interpolation, Light, Lights, RenderOptions};

    use super::*;

    /// Evenly distributed numbers.
    fn numbers() -> impl FnMut() -> f32 {
        let mut state = 7_u32;
        move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        }
    }

    #[test]
    fn vectors_and_single_points_are_lit_alike() {
        let mut unit = numbers();
        let mut vector = |low: f32| Vec3::new(unit(), unit(), unit()) * (1.0 - low) + low;
        let shaded: Vec<(Hit, Shaded<'_>)> = (0..1000)
            .map(|index| {
                let normal = vector(-1.0).normalize_or(Vec3::Z);
                let [occlusion, roughness, metallic] = vector(0.0).to_array();
                let material = MaterialSample {
                    base_color: vector(0.0),
                    emission: if index % 3 == 0 { vector(0.0) } else { Vec3::ZERO },
                    mirrored: if index % 4 == 0 { vector(0.0) } else { Vec3::ZERO },
                    occlusion,
                    roughness: if index % 7 == 0 { 0.0 } else { roughness },
                    metallic: if index % 5 == 0 { 1.0 } else { metallic },
                    unlit: index % 11 == 0,
                    ..MaterialSample::with_normal(normal)
                };
                let modulate = if index % 2 == 0 { Vec3::ONE } else { Vec3::X };
                let finish = (index % 13 == 0).then(|| Finish { modulate, ..Finish::default() });
                let hit = Hit {
                    at: SurfacePoint::corner(0, 0),
                    lambda_steps: [Vec3::ZERO; 2],
                    front: true,
                    // Mirrored, along the normal, and any other.
                    to_eye: if index % 17 == 0 { normal } else { vector(-1.0).normalize_or(Vec3::X) },
                };
                (hit, (material, finish))
            })
            .collect();
        let (hits, materials): (Vec<_>, Vec<_>) = shaded.into_iter().unzip();
        let mesh = Mesh::default();
        let surface = FlatSurface::new(&mesh, FlatShading::Unlit, |_| Vec3::ONE);
        let mut lights = Lights::default();
        lights.lamps.push(Light::directional(Vec3::new(1.0, -0.3, 0.2), Vec3::new(0.3, 0.2, 0.1)));
        let prepared = PreparedLights::new(&lights, &mesh, &surface, &RenderOptions::default()).unwrap();
        assert!(prepared.distant().is_some());
        let camera = Camera { eye: DVec3::Z, target: DVec3::ZERO, up: DVec3::Y, fov_degrees: 60.0 };
        let projection = Projection::new(&camera, [640, 360], &mesh);
        let interpolation = Interpolation::Perspective;
        let finder = HitFinder { mesh: &mesh, projection: &projection, interpolation, spacing: 1.0 };
        let mut light = Vec::new();
        let shading = Shading::MetallicRoughness;
        evaluate_all(shading, (&hits, &materials), &finder, &surface, &prepared, &mut light);
        assert_eq!(light.len(), hits.len());
        for ((hit, (material, finish)), light) in hits.iter().zip(&materials).zip(light) {
            let arriving = prepared.at(&mesh, &surface, hit);
            let expected = evaluate(shading, material, finish.as_ref(), hit.to_eye, &arriving);
            let difference = (light - expected).abs().max_element();
            assert!(difference <= 1e-5 * expected.max_element().max(1.0), "{light} {expected} {material:?}");
        }
    }
}
