//! A document in the graphics memory.

use std::sync::Arc;

use eframe::wgpu;
use fantex_gpu::{Gpu, GpuError, Model, UvModel};

use super::atlas_view::AtlasPicture;
use super::fan::FanScene;
use crate::document::{Content, Document};
use crate::figures::StreamFigures;
use crate::settings::StreamingSettings;
use crate::viewer::Viewer;

/// Brings a document to the graphics memory; takes long, so on the thread that opens it. Fails with one sentence.
pub type PrepareScene = Arc<dyn Fn(&Document, StreamingSettings) -> Result<SceneModel, String> + Send + Sync>;

/// A document in the graphics memory.
#[derive(Debug)]
pub enum SceneModel {
    /// A model with its own textures.
    Uv(Box<UvModel>),
    /// An asset, streamed.
    Fan(Box<FanScene>),
}

/// Brings documents to a GPU.
pub fn preparer(gpu: Arc<Gpu>) -> PrepareScene {
    Arc::new(move |document, settings| match &document.content {
        Content::Model(mesh) => {
            let model = UvModel::load(&gpu, mesh).map_err(|error| error.to_string())?;
            Ok(SceneModel::Uv(Box::new(model)))
        }
        Content::Asset(asset) => {
            let scene = FanScene::new(&gpu, asset.clone(), settings, document.exchange.clone());
            let scene = scene.map_err(|error| error.to_string())?;
            Ok(SceneModel::Fan(Box::new(scene)))
        }
    })
}

impl SceneModel {
    /// What the renderer draws.
    pub(super) fn drawn(&mut self) -> &mut dyn Model {
        match self {
            Self::Uv(model) => &mut **model,
            Self::Fan(scene) => scene.model(),
        }
    }

    /// Lets streaming go on for a frame. Returns whether something has changed that may be seen.
    pub(super) fn stream(
        &mut self,
        gpu: &Gpu,
        viewer: &Viewer,
        elapsed_seconds: f32,
    ) -> Result<bool, GpuError> {
        match self {
            Self::Uv(_) => Ok(false),
            Self::Fan(scene) => scene.stream(gpu, viewer, elapsed_seconds),
        }
    }

    /// What streaming tells, where there is any.
    pub(super) fn figures(&self) -> Option<StreamFigures> {
        match self {
            Self::Uv(_) => None,
            Self::Fan(scene) => Some(scene.figures()),
        }
    }

    /// Whether the picture stays as it is until the view changes.
    pub(super) fn is_settled(&self) -> bool {
        match self {
            Self::Uv(_) => true,
            Self::Fan(scene) => scene.is_settled(),
        }
    }

    /// Whether the atlas has changed since its picture was made.
    pub(super) fn is_atlas_stale(&self) -> bool {
        match self {
            Self::Uv(_) => false,
            Self::Fan(scene) => scene.is_atlas_stale(),
        }
    }

    pub(super) fn atlas(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        channel: usize,
        seconds: f64,
    ) -> Option<AtlasPicture<'_>> {
        match self {
            Self::Uv(_) => None,
            Self::Fan(scene) => scene.atlas(gpu, encoder, channel, seconds),
        }
    }
}
