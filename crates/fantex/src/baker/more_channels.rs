//! Channels that an asset is to have though its source has none of their kind.

use fantex_bake::{LightMapSource, Prefilter, Source, SourceChannel, TexelPoint};
use fantex_mesh::{Material, Mesh};
use fantex_store::{ChannelKind, Damage};
use glam::{Vec3, Vec4};

/// A source and the channels that it lacks.
pub(super) struct WithChannels<'a> {
    source: &'a dyn Source,
    mesh: &'a Mesh,
    /// The source's own.
    own: usize,
    missing: Vec<(ChannelKind, Vec4)>,
}

impl<'a> WithChannels<'a> {
    /// `wanted`: what the mesh's materials do not say about a channel. None where the source has all of them.
    pub(super) fn of(source: &'a dyn Source, mesh: &'a Mesh, wanted: &[(ChannelKind, Vec4)]) -> Option<Self> {
        let own = source.channels();
        let is_missing = |kind: ChannelKind| own.iter().all(|channel| channel.kind != kind);
        let missing: Vec<_> = wanted.iter().copied().filter(|(kind, _)| is_missing(*kind)).collect();
        (!missing.is_empty()).then_some(Self { source, mesh, own: own.len(), missing })
    }

    /// The value of a channel that the source lacks. Its tiles take the place of the materials' factors.
    fn value(&self, kind: ChannelKind, unsaid: Vec4, point: &TexelPoint) -> Vec4 {
        let material = &self.mesh.materials[self.mesh.material_of(point.at.index())];
        match kind {
            ChannelKind::Normal => point.normal.extend(0.0),
            ChannelKind::OcclusionRoughnessMetallic if says_surface(material) => {
                Vec4::new(1.0, material.roughness, material.metallic, 1.0)
            }
            ChannelKind::Emission if material.emission != Vec3::ZERO => material.emission.extend(1.0),
            _ => unsaid,
        }
    }

    /// Fills in what the source lacks; `evaluate` writes its own values.
    fn evaluate_with(&self, points: &[TexelPoint], values: &mut [Vec4], evaluate: impl FnOnce(&mut [Vec4])) {
        let mut own = vec![Vec4::ZERO; points.len() * self.own];
        evaluate(&mut own);
        let channels = self.own + self.missing.len();
        for ((point, own), values) in points.iter().zip(own.chunks(self.own)).zip(values.chunks_mut(channels))
        {
            let (known, missing) = values.split_at_mut(self.own);
            known.copy_from_slice(own);
            for (value, &(kind, unsaid)) in missing.iter_mut().zip(&self.missing) {
                *value = self.value(kind, unsaid, point);
            }
        }
    }
}

/// Whether a material says how rough or metallic it is.
fn says_surface(material: &Material) -> bool {
    let plain = Material::default();
    (material.roughness, material.metallic) != (plain.roughness, plain.metallic)
}

impl Source for WithChannels<'_> {
    fn channels(&self) -> Vec<SourceChannel> {
        let glows = self.mesh.materials.iter().any(|material| material.emission.max_element() > 1.0);
        let missing = self.missing.iter().map(|&(kind, unsaid)| SourceChannel {
            exceeds_one: unsaid.max_element() > 1.0 || glows && kind == ChannelKind::Emission,
            ..SourceChannel::new(kind)
        });
        self.source.channels().into_iter().chain(missing).collect()
    }

    fn prefilter(&self) -> Prefilter {
        self.source.prefilter()
    }

    fn crosses_creases(&self) -> bool {
        self.source.crosses_creases()
    }

    fn jumps_at_creases(&self) -> bool {
        self.source.jumps_at_creases()
    }

    fn has_shares(&self) -> bool {
        self.source.has_shares()
    }

    fn has_slow_points(&self) -> bool {
        self.source.has_slow_points()
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let evaluate = |own: &mut [Vec4]| self.source.evaluate(point, own);
        self.evaluate_with(std::slice::from_ref(point), values, evaluate);
    }

    fn evaluate_all(&self, points: &[TexelPoint], values: &mut [Vec4]) {
        self.evaluate_with(points, values, |own| self.source.evaluate_all(points, own));
    }

    fn light_map(&self) -> Option<&LightMapSource<'_>> {
        self.source.light_map()
    }

    fn damage(&self) -> Damage {
        self.source.damage()
    }

    fn evaluate_lit(&self, points: &[TexelPoint], light: &[Vec3], values: &mut [Vec4]) {
        self.evaluate_with(points, values, |own| self.source.evaluate_lit(points, light, own));
    }
}

#[cfg(test)]
mod tests {
    use fantex_bake::TrianglePlane;
    use fantex_mesh::generate::cube;
    use fantex_test::cleaned;

    use super::*;

    /// A cut-out in base colour.
    struct Positions;

    impl Source for Positions {
        fn has_shares(&self) -> bool {
            true
        }

        fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
            values[0] = point.position.extend(0.5);
        }
    }

    #[test]
    fn what_a_source_lacks_comes_from_materials_or_is_one_value() {
        let mut mesh = cleaned(cube(1));
        let emission = Vec3::new(5.0, 0.0, 0.0);
        let lamp = Material { roughness: 0.2, metallic: 1.0, emission, ..Material::default() };
        mesh.materials = vec![Material::default(), lamp];
        mesh.triangle_materials = (0..12).map(|triangle| triangle % 2).collect();
        let (plain, black, middle) = (Vec4::new(1.0, 0.6, 0.0, 1.0), Vec4::W, Vec4::splat(0.5));
        let wanted = [
            (ChannelKind::BaseColor, black),
            (ChannelKind::OcclusionRoughnessMetallic, plain),
            (ChannelKind::Emission, black),
            (ChannelKind::Normal, Vec4::ZERO),
            (ChannelKind::Displacement, middle),
        ];
        assert!(WithChannels::of(&Positions, &mesh, &wanted[..1]).is_none());
        let source = WithChannels::of(&Positions, &mesh, &wanted).unwrap();
        assert!(source.has_shares());
        let channels = source.channels();
        assert!(channels.iter().map(|channel| channel.kind).eq(wanted.map(|(kind, _)| kind)));
        let exceeding = channels.iter().filter(|channel| channel.exceeds_one);
        assert!(exceeding.map(|channel| channel.kind).eq([ChannelKind::Emission]));

        let point = |triangle| {
            TrianglePlane::new(&mesh, &[], triangle, [Vec3::ZERO; 2]).point(Vec3::splat(1.0 / 3.0))
        };
        let points = [0, 1].map(point);
        let says = [[plain, black], [Vec4::new(1.0, 0.2, 1.0, 1.0), emission.extend(1.0)]];
        let expected = points.iter().zip(says).flat_map(|(point, [surface, glow])| {
            [point.position.extend(0.5), surface, glow, point.normal.extend(0.0), middle]
        });
        let expected: Vec<Vec4> = expected.collect();
        let mut values = [Vec4::NAN; 10];
        source.evaluate_all(&points, &mut values);
        assert_eq!(values.as_slice(), expected);
        source.evaluate(&points[1], &mut values[..5]);
        assert_eq!(values[..5], expected[5..]);
    }
}
