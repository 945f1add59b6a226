//! Coordinates, texture matrices and places.

use fantex_look::Key;
use fantex_look::data::{
    CoordinatesKind, CoordinatesTable, HemisphereLayoutName, MatrixTable, OMapName, PlaceTable, PlaceUnit,
    SurfaceTable, TriplanarTable,
};
use glam::{DAffine3, DMat4, DQuat, DVec3, EulerRot, Mat3, Vec2, Vec3};

use super::convert::{vec2, vec3};
use super::{Made, Resolver};
use crate::coordinates::{Coordinates, SpaceMatrix, SpaceMatrixOptions, TextureMatrix, TextureMatrixOptions};
use crate::{HemisphereLayout, OMap, Placement, SMap, Shape, ShapeKind, TriplanarMap, TwoPartMapping};

impl Resolver<'_> {
    pub(super) fn coordinates(&self, table: &CoordinatesTable, key: &Key) -> Made<Coordinates> {
        let coordinates = match &table.0 {
            CoordinatesKind::Uv(table) => Coordinates::Uv { set: table.set as usize },
            CoordinatesKind::Plane(table) => self.surface(ShapeKind::Plane, table, key)?,
            CoordinatesKind::Box(table) => self.surface(ShapeKind::Box, table, key)?,
            CoordinatesKind::Cylinder(table) => self.surface(ShapeKind::Cylinder, table, key)?,
            CoordinatesKind::Sphere(table) => self.surface(ShapeKind::Sphere, table, key)?,
            CoordinatesKind::Hemispheres(table) => self.surface(ShapeKind::Hemispheres, table, key)?,
            CoordinatesKind::Triplanar(table) => Coordinates::Triplanar(self.triplanar(table)),
        };
        self.accept(key, coordinates.check())?;
        Ok(coordinates)
    }

    fn surface(&self, kind: ShapeKind, table: &SurfaceTable, key: &Key) -> Made<Coordinates> {
        let mut shape = kind.fit(self.bounds);
        if let Shape::Hemispheres(map) = &mut shape {
            map.layout = match table.layout {
                HemisphereLayoutName::Shared => HemisphereLayout::Shared,
                HemisphereLayoutName::SideBySide => HemisphereLayout::SideBySide,
            };
        }
        let placement = Placement {
            pivot: vec3(table.pivot),
            scale: vec3(table.scale.axes()),
            rotation: Placement::rotation_from_degrees(vec3(table.rotate)),
            translation: vec3(table.translate),
        };
        let s_map = self.accept(key, SMap::new(shape, &placement))?;
        let o_map = match table.o_map {
            OMapName::SurfaceNormal => return Ok(Coordinates::Surface(s_map)),
            OMapName::Reflection => OMap::Reflection,
            OMapName::ObjectNormal => OMap::ObjectNormal,
            OMapName::Centroid => OMap::Centroid { center: vec3(table.pivot) },
        };
        Ok(Coordinates::TwoPart(TwoPartMapping { s_map, o_map }))
    }

    fn triplanar(&self, table: &TriplanarTable) -> TriplanarMap {
        let fitted = TriplanarMap::fit(self.bounds);
        let scale = table.size.map_or(fitted.scale, |size| 1.0 / size as f32);
        TriplanarMap { scale, sharpness: table.sharpness as f32, ..fitted }
    }

    pub(super) fn matrix(&self, table: &MatrixTable, key: &Key) -> Made<TextureMatrix> {
        let [x, y, _] = table.scale.axes();
        let options = TextureMatrixOptions {
            matrix: table.projective.map_or(Mat3::IDENTITY, |rows| {
                Mat3::from_cols_array_2d(&rows.map(|row| row.map(|n| n as f32))).transpose()
            }),
            pivot: vec2(table.pivot),
            scale: vec2([x, y]),
            rotation: table.rotate as f32,
            translation: vec2(table.translate),
            scale_per_second: Vec2::splat(table.grow as f32),
            rotation_per_second: table.spin as f32,
            translation_per_second: vec2(table.shift_per_second),
        };
        self.accept(key, TextureMatrix::new(options))
    }

    /// From the object's space to a pattern's. The pattern is an object of its own, so its motion is the inverse of that
    /// of the coordinates.
    pub(super) fn place(&self, table: &PlaceTable, key: &Key) -> Made<SpaceMatrix> {
        let unit = match table.unit {
            PlaceUnit::World => 1.0,
            PlaceUnit::Model => f64::from(self.radius()),
        };
        let scale = DVec3::from_array(table.scale.axes()) * unit;
        let [x, y, z] = table.rotate.map(f64::to_radians);
        let rotation = DQuat::from_euler(EulerRot::ZYX, z, y, x);
        let object_from_pattern =
            DAffine3::from_scale_rotation_translation(scale, rotation, DVec3::from_array(table.center));
        let options = SpaceMatrixOptions {
            matrix: DMat4::from(object_from_pattern.inverse()).as_mat4(),
            rotation_per_second: -vec3(table.spin),
            translation_per_second: -vec3(table.shift_per_second),
            ..SpaceMatrixOptions::default()
        };
        self.accept(key, SpaceMatrix::new(options))
    }

    /// Radius of the sphere around the bounding box, world units; 1 for a point.
    pub(super) fn radius(&self) -> f32 {
        let radius = 0.5 * (self.bounds.max - self.bounds.min).length();
        if radius > 0.0 { radius } else { 1.0 }
    }

    /// Extents of the bounding box, none of them 0.
    pub(super) fn extent(&self) -> Vec3 {
        self.bounds.extent()
    }
}
