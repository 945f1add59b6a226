//! The tool *Gradient*: the foreground where a drag begins, another colour or nothing where it ends, and mixtures between.

use std::path::PathBuf;

use fantex::glam::{DVec2, Vec3};
use fantex::paint::{ColorSettings, PaintColor, SurfacePoint, Target, TextureGraph};
use fantex::store::ChannelKind;
use serde::{Deserialize, Serialize};

use crate::notices::Notices;
use crate::paint::colors::text_hex;
use crate::paint::cursor::world_position;
use crate::paint::hand::CLICK_SHARE;
use crate::paint::painting::Hand;
use crate::paint::{ChosenTexture, Colors, PaintSettings, PaintTool, Painting, StrokeStart, Viewpoint};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GradientSettings {
    pub shape: GradientShape,
    pub end: GradientEnd,
    /// Whether colours change slowly at both ends.
    pub is_smooth: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GradientShape {
    /// Alike in planes across the drag.
    #[default]
    Straight,
    /// Alike in spheres around its beginning.
    Round,
}

impl GradientShape {
    pub const ALL: [(Self, &'static str); 2] = [(Self::Straight, "Straight"), (Self::Round, "Round")];
}

/// What is where the drag ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GradientEnd {
    #[default]
    Background,
    /// What was there before.
    Nothing,
}

impl GradientEnd {
    pub const ALL: [(Self, &'static str); 2] = [(Self::Background, "Background"), (Self::Nothing, "Nothing")];
}

/// The name of a gradient's texture in its look.
const GRADIENT: &str = "gradient";

impl GradientSettings {
    /// A look with the gradient between two places, object space.
    fn graph(self, colors: &Colors, [begin, end]: [Vec3; 2]) -> TextureGraph {
        let [from, along] = [begin, (end - begin).normalize_or(Vec3::Y)].map(|v| v.to_array());
        let length = begin.distance(end);
        let way = match self.shape {
            GradientShape::Straight => {
                format!("kind = \"height\"\norigin = {from:?}\ndirection = {along:?}\n")
            }
            GradientShape::Round => format!("kind = \"distance\"\ncenter = {from:?}\n"),
        };
        let interpolation = if self.is_smooth { "smooth" } else { "linear" };
        let ramp = |name: &str, [first, last]: [&str; 2]| {
            format!(
                "[textures.{name}]\nkind = \"ramp\"\ninput = \"way\"\ninterpolation = \"{interpolation}\"\n\
                 stops = [{{ at = 0.0, color = \"{first}\" }}, {{ at = {length:?}, color = \"{last}\" }}]\n\n"
            )
        };
        let [foreground, background] = [colors.foreground, colors.background].map(text_hex);
        let colors = match self.end {
            GradientEnd::Background => ramp(GRADIENT, [&foreground, &background]),
            GradientEnd::Nothing => format!(
                "[textures.{GRADIENT}]\nkind = \"combine\"\nmode = \"modulate\"\ntexture = \"cover\"\n\
                 fragment = \"{foreground}\"\n\n\
                 [textures.cover]\nkind = \"swizzle\"\ninput = \"share\"\nchannels = [\"one\", \"one\", \"one\", \"r\"]\n\n{}",
                ramp("share", ["#ffffff", "#000000"])
            ),
        };
        TextureGraph { look: format!("{colors}[textures.way]\n{way}"), folder: PathBuf::new() }
    }
}

/// A drag that a gradient is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GradientDrag {
    begin: SurfacePoint,
    /// Where it began and where it is, 0..1 along the scene's sides.
    places: [DVec2; 2],
}

impl GradientDrag {
    pub(super) fn begun(begin: SurfacePoint, at: DVec2) -> Self {
        Self { begin, places: [at; 2] }
    }

    pub(super) fn moved(self, at: DVec2) -> Self {
        Self { places: [self.places[0], at], ..self }
    }
}

impl Painting {
    /// Where the drag of a gradient began and where it is, 0..1 along the scene's sides; none without such a drag.
    pub fn gradient_line(&self) -> Option<[DVec2; 2]> {
        let Hand::Gradient(drag) = self.hand else { return None };
        Some(drag.places)
    }

    /// Lays the gradient of a drag that has ended, unless a key has taken another tool meanwhile.
    pub(super) fn lay_gradient(
        &mut self,
        drag: GradientDrag,
        settings: &mut PaintSettings,
        view: &Viewpoint,
        notices: &mut Notices,
    ) {
        if settings.tool != PaintTool::Gradient {
            return;
        }
        let [from, to] = drag.places;
        if (to - from).length() <= CLICK_SHARE {
            return notices.info("Gradient: drag from where the foreground is to where it ends.");
        }
        match self.gradient(drag, settings, view, notices) {
            Ok(start) => {
                settings.colors.used();
                self.fill(start, drag.begin, settings);
            }
            Err(reason) => notices.warning(reason),
        }
    }

    /// What the gradient of a drag fills with, or why it cannot.
    fn gradient(
        &mut self,
        drag: GradientDrag,
        settings: &mut PaintSettings,
        view: &Viewpoint,
        notices: &mut Notices,
    ) -> Result<Box<StrokeStart>, String> {
        let mut start = self.start(drag.begin, settings, view, notices)?;
        let is_mask = matches!(start.target, Target::Mask(_));
        let has_colors = |kind: ChannelKind| is_mask || kind == ChannelKind::BaseColor;
        start.paint.channels.retain(|paint| has_colors(self.channels[paint.channel].kind));
        start.recorded.channels.retain(|channel| has_colors(channel.kind));
        if start.paint.channels.is_empty() {
            return Err("A gradient goes into the base colour: switch that on, or choose a mask.".into());
        }
        let graph = settings.gradient.graph(&settings.colors, self.ends(drag, view));
        let texture = graph.texture(&self.surface, GRADIENT).map_err(|error| error.to_string())?;
        let chosen = ChosenTexture { graph, name: GRADIENT.into(), texture };
        for (paint, recorded) in start.paint.channels.iter_mut().zip(&mut start.recorded.channels) {
            paint.color = PaintColor::Texture(chosen.texture.clone());
            recorded.color = ColorSettings::Texture { look: chosen.look(), name: chosen.name.clone() };
        }
        Ok(start)
    }

    /// Both ends of a gradient, object space. The second one is as deep in the picture as the first, whatever lies below it: so colours
    /// change across the picture as the drag goes.
    fn ends(&self, drag: GradientDrag, view: &Viewpoint) -> [Vec3; 2] {
        let begin = world_position(&self.surface, drag.begin);
        let (eye, forward) = (view.rig.eye, view.rig.forward());
        let ray = view.rig.ray(drag.places[1], view.aspect());
        let end = eye + ray * ((begin - eye).dot(forward) / ray.dot(forward));
        let mesh_from_world = |p| self.surface.mesh().world_from_mesh.inverse_point(p);
        [begin, end].map(|p| self.surface.space().point(mesh_from_world(p)))
    }
}
