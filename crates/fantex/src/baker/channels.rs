//! Channels that a source is to have though it gives none of their kind.

use std::ops::Deref;
use std::sync::Arc;

use fantex_bake::{AssetSource, LightMapSource, Prefilter, Source, SourceChannel, TexelPoint};
use fantex_mesh::{Material, Mesh};
use fantex_store::{Asset, Channel, ChannelKind, Damage, PageCache};
use glam::{Vec3, Vec4};

use super::materials::used_materials;

/// A source with certain channels. Those that it lacks hold what the materials of its mesh say, and normals are the mesh's own.
pub(crate) struct FilledChannels<S, M> {
    source: S,
    mesh: M,
    /// How many channels the source has.
    own: usize,
    channels: Vec<FilledChannel>,
}

/// An asset as a source of certain channels.
pub(crate) type AssetChannels = FilledChannels<Box<AssetSource>, Arc<Mesh>>;

struct FilledChannel {
    channel: SourceChannel,
    origin: Origin,
}

/// Where the values of a channel come from.
#[derive(Clone, Copy, PartialEq)]
enum Origin {
    /// The source's channel of this number.
    Source(usize),
    /// The material; where it says nothing, this value is taken, if there is one.
    Material(Option<Vec4>),
}

impl<'a> FilledChannels<&'a dyn Source, &'a Mesh> {
    /// All channels of a source, then those that it lacks. `wanted`: what they are where the mesh's materials say nothing. None where the source has
    /// all of them.
    pub(super) fn of(source: &'a dyn Source, mesh: &'a Mesh, wanted: &[(ChannelKind, Vec4)]) -> Option<Self> {
        let own = source.channels();
        let glows = mesh.materials.iter().any(|material| material.emission.max_element() > 1.0);
        let is_missing = |kind: ChannelKind| own.iter().all(|channel| channel.kind != kind);
        let missing = wanted.iter().filter(|(kind, _)| is_missing(*kind)).map(|&(kind, unsaid)| {
            let exceeds_one = unsaid.max_element() > 1.0 || glows && kind == ChannelKind::Emission;
            let channel = SourceChannel { exceeds_one, ..SourceChannel::new(kind) };
            FilledChannel { channel, origin: Origin::Material(Some(unsaid)) }
        });
        let missing: Vec<FilledChannel> = missing.collect();
        if missing.is_empty() {
            return None;
        }
        let count = own.len();
        let own = own.into_iter().enumerate();
        let own = own.map(|(number, channel)| FilledChannel { channel, origin: Origin::Source(number) });
        Some(Self { source, mesh, own: count, channels: own.chain(missing).collect() })
    }
}

impl AssetChannels {
    /// An asset's own channels, and those in which its materials differ.
    pub(crate) fn all_of(asset: &Arc<Asset>, memory_bytes: u64) -> Self {
        let source = asset_source(asset, memory_bytes);
        let mut channels = source.channels();
        let materials = used_materials(asset.mesh());
        for kind in [ChannelKind::BaseColor, ChannelKind::OcclusionRoughnessMetallic, ChannelKind::Emission] {
            let of_material = |material: &&Material| Vec4::from(Channel::plain_value_of(kind, material));
            let differs = materials.windows(2).any(|pair| of_material(&pair[0]) != of_material(&pair[1]));
            if differs && channels.iter().all(|channel| channel.kind != kind) {
                let exceeds_one = materials.iter().any(|m| of_material(m).max_element() > 1.0);
                channels.push(SourceChannel { exceeds_one, ..SourceChannel::new(kind) });
            }
        }
        Self::of_asset(source, asset, channels)
    }

    /// What `source` gives of the asset that it reads, as these channels.
    pub(crate) fn of_asset(source: AssetSource, asset: &Arc<Asset>, channels: Vec<SourceChannel>) -> Self {
        let own = source.channels();
        let filled = |channel: SourceChannel| {
            let number = own.iter().position(|own| own.kind == channel.kind);
            FilledChannel { channel, origin: number.map_or(Origin::Material(None), Origin::Source) }
        };
        let channels = channels.into_iter().map(filled).collect();
        Self { source: Box::new(source), mesh: asset.shared_mesh(), own: own.len(), channels }
    }
}

/// Reads an asset with so much memory for decoded texels.
pub(crate) fn asset_source(asset: &Arc<Asset>, memory_bytes: u64) -> AssetSource {
    let bytes = usize::try_from(memory_bytes).unwrap_or(usize::MAX);
    AssetSource::new(&PageCache::new(Arc::clone(asset), bytes))
}

impl<S, M: Deref<Target = Mesh>> FilledChannels<S, M> {
    /// Fills in what the source lacks; `evaluate` writes its own values.
    fn fill(&self, points: &[TexelPoint], values: &mut [Vec4], evaluate: impl FnOnce(&mut [Vec4])) {
        let origins = self.channels.iter().map(|filled| filled.origin);
        if origins.eq((0..self.own).map(Origin::Source)) {
            return evaluate(values);
        }
        let mut own = vec![Vec4::ZERO; points.len() * self.own];
        evaluate(&mut own);
        let values = values.chunks_mut(self.channels.len());
        for ((number, point), values) in points.iter().enumerate().zip(values) {
            let own = &own[number * self.own..][..self.own];
            for (value, filled) in values.iter_mut().zip(&self.channels) {
                *value = self.value(filled, own, point);
            }
        }
    }

    /// The value of a channel at a point, at which the source has its `own` values.
    fn value(&self, filled: &FilledChannel, own: &[Vec4], point: &TexelPoint) -> Vec4 {
        let kind = filled.channel.kind;
        let unsaid = match filled.origin {
            Origin::Source(number) => return own[number],
            Origin::Material(_) if kind == ChannelKind::Normal => return point.normal.extend(0.0),
            Origin::Material(unsaid) => unsaid,
        };
        let plain = Material::default();
        let material = self.mesh.materials.get(self.mesh.material_of(point.at.index())).unwrap_or(&plain);
        match unsaid {
            Some(unsaid) if !says(kind, material) => unsaid,
            _ => Channel::plain_value_of(kind, material).into(),
        }
    }
}

/// Whether a material says what is in a channel, beside the colour that scales the source's.
fn says(kind: ChannelKind, material: &Material) -> bool {
    let plain = Material::default();
    match kind {
        ChannelKind::OcclusionRoughnessMetallic => {
            (material.roughness, material.metallic) != (plain.roughness, plain.metallic)
        }
        ChannelKind::Emission => material.emission != plain.emission,
        _ => false,
    }
}

impl<S, M> Source for FilledChannels<S, M>
where
    S: Deref<Target: Source> + Sync,
    M: Deref<Target = Mesh> + Sync,
{
    fn channels(&self) -> Vec<SourceChannel> {
        self.channels.iter().map(|filled| filled.channel).collect()
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
        self.fill(std::slice::from_ref(point), values, evaluate);
    }

    fn evaluate_all(&self, points: &[TexelPoint], values: &mut [Vec4]) {
        self.fill(points, values, |own| self.source.evaluate_all(points, own));
    }

    fn light_map(&self) -> Option<&LightMapSource<'_>> {
        self.source.light_map()
    }

    fn damage(&self) -> Damage {
        self.source.damage()
    }

    fn evaluate_lit(&self, points: &[TexelPoint], light: &[Vec3], values: &mut [Vec4]) {
        self.fill(points, values, |own| self.source.evaluate_lit(points, light, own));
    }
}

#[cfg(test)]
mod tests {
    use fantex_bake::TrianglePlane;
    use fantex_mesh::Material;
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
        assert!(FilledChannels::of(&Positions, &mesh, &wanted[..1]).is_none());
        let source = FilledChannels::of(&Positions, &mesh, &wanted).unwrap();
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
