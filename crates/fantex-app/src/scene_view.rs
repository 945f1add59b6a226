//! The scene in the graphics memory.
use std::sync::Arc;
use crate::document::Document;

/// A document in the graphics memory.
#[derive(Debug)]
pub struct SceneModel;

/// Brings a document to the graphics memory; takes long, so on the thread that opens it. Fails with one sentence.
pub type PrepareScene = Arc<dyn Fn(&Document) -> Result<SceneModel, String> + Send + Sync>;
