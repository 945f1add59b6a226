//! A document in the graphics memory.

use std::sync::Arc;

use eframe::wgpu;
use fantex_gpu::{Gpu, GpuError, Model, UvModel};

use crate::document::{Content, Document};
use crate::figures::StreamFigures;
use crate::viewer::Viewer;

/// Brings a document to the graphics memory; takes long, so on the thread that opens it. Fails with one sentence.
pub type PrepareScene = Arc<dyn Fn(&Document) -> Result<SceneModel, String> + Send + Sync>;

/// A document in the graphics memory.
#[derive(Debug)]
pub enum SceneModel {
    /// A model with its own textures.
    Uv(Box<UvModel>),
}

/// Layers of the atlas, to be shown.
#[derive(Debug)]
pub struct AtlasPictures<'a> {
    /// One per layer.
    pub views: &'a [wgpu::TextureView],
    /// Whether they are others than at the last call.
    pub are_new: bool,
    /// Texels along a layer's side.
    pub side: u32,
}

/// Brings documents to a GPU.
pub fn preparer(gpu: Arc<Gpu>) -> PrepareScene {
    Arc::new(move |document| match &document.content {
        Content::Model(mesh) => {
            let model = UvModel::load(&gpu, mesh).map_err(|error| error.to_string())?;
            Ok(SceneModel::Uv(Box::new(model)))
        }
        Content::Asset(_) => Err("assets cannot be shown yet".into()),
    })
}

impl SceneModel {
    /// What the renderer draws.
    pub(super) fn drawn(&mut self) -> &mut dyn Model {
        match self {
            Self::Uv(model) => &mut **model,
        }
    }

    /// Lets streaming go on for a frame. Returns whether something has arrived that is seen.
    pub(super) fn stream(
        &mut self,
        _gpu: &Gpu,
        _encoder: &mut wgpu::CommandEncoder,
        _viewer: &Viewer,
        _elapsed_seconds: f32,
    ) -> Result<bool, GpuError> {
        match self {
            Self::Uv(_) => Ok(false),
        }
    }

    /// What streaming tells, where there is any.
    pub(super) fn figures(&self) -> Option<StreamFigures> {
        match self {
            Self::Uv(_) => None,
        }
    }

    pub(super) fn is_sharp(&self) -> bool {
        match self {
            Self::Uv(_) => true,
        }
    }

    pub(super) fn is_streaming(&self) -> bool {
        match self {
            Self::Uv(_) => false,
        }
    }

    pub(super) fn atlas(&mut self, _gpu: &Gpu, _channel: usize) -> Option<AtlasPictures<'_>> {
        match self {
            Self::Uv(_) => None,
        }
    }
}
