//! Polygons.

use std::sync::Arc;

use fantex_look::Key;
use fantex_look::data::{PolygonTable, PolygonsTable};

use super::convert::vec2;
use super::{Made, Resolver};
use crate::{DetailPolygon, PolygonsTexture, Texture};

impl Resolver<'_> {
    pub(super) fn polygons(&mut self, table: &PolygonsTable, key: &Key) -> Made<Arc<dyn Texture>> {
        let list = key.name("polygons");
        let polygons: Vec<DetailPolygon> = (0..).zip(&table.polygons).map(polygon).collect();
        let colors = table.polygons.iter().enumerate();
        let colors = colors.map(|(i, polygon)| self.input(&polygon.color, &list.index(i).name("color")));
        let colors = colors.collect::<Made<Vec<_>>>()?;
        let base = self.input(&table.base, &key.name("base"))?;
        let place = (
            self.coordinates(&table.coordinates, &key.name("coordinates"))?,
            self.matrix(&table.matrix, &key.name("matrix"))?,
        );
        let texture = PolygonsTexture::new(&polygons, colors, base, place, table.repeat);
        Ok(Arc::new(self.accept(&list, texture)?))
    }
}

fn polygon((material, table): (u32, &PolygonTable)) -> DetailPolygon {
    let outlines = table.outlines.iter().map(|outline| outline.iter().map(|&corner| vec2(corner)).collect());
    DetailPolygon { outlines: outlines.collect(), material, priority: table.priority }
}
