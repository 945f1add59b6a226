//! Texture graphs: textures of a look, on the model that is painted on.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use fantex_base::{Error, Result, input};
use fantex_look::{LookFile, LookImages, ResolveOptions, Resolver};
use fantex_texture::Texture;
use glam::Vec4;
use serde::{Deserialize, Serialize};

use crate::composite::shade;
use crate::layers::Layers;
use crate::mask_source::Measured;
use crate::texel_page::{Rect, TexelPage};
use crate::{LayerContent, MaskMeasure, MaskSource, Surface};

/// A look's text, and the folder that the files it mentions are relative to.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TextureGraph {
    /// TOML.
    pub look: String,
    /// Of images and volumes.
    pub folder: PathBuf,
}

impl TextureGraph {
    /// The texture of a name.
    ///
    /// # Errors
    /// The look is wrong, has no such texture, or the texture cannot be made or depends on the eye.
    pub fn texture(&self, surface: &Surface, name: &str) -> Result<Arc<dyn Texture>> {
        let file = LookFile::parse(&self.look, &self.folder.join("look.toml"));
        let images = LookImages::default();
        let made = file.and_then(|file| {
            Resolver::new(&file, surface.mesh(), &images, ResolveOptions::default()).texture(name)
        });
        let texture = made.map_err(|source| match self.folder.is_dir() {
            true => source,
            false => {
                let folder = self.folder.display();
                let sentence = format!(
                    "the files of the look with the texture {name:?} are not found ({source}): their folder was {folder}; \
                     put them there again, or move asset and look together"
                );
                Error::not_found(sentence).with_path(&self.folder).with_source(source)
            }
        })?;
        if texture.is_view_dependent() {
            return Err(Error::invalid(format!(
                "the texture {name:?} depends on the eye and cannot be painted with"
            )));
        }
        Ok(texture)
    }

    /// The names of the look's textures, ascending.
    ///
    /// # Errors
    /// The look is wrong.
    pub fn names(&self) -> Result<Vec<String>> {
        let file = LookFile::parse(&self.look, &self.folder.join("look.toml"))?;
        Ok(file.look().textures.keys().cloned().collect())
    }
}

// Fill layers that show a texture graph.

/// Textures of a graph, one per channel of the asset.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GraphFill {
    /// Where they are defined.
    pub graph: TextureGraph,
    /// Their names; none where the layer does not show in a channel. Channels beyond the list have none.
    pub textures: Vec<Option<String>>,
}

/// One per channel.
type Textures = Vec<Option<Arc<dyn Texture>>>;

/// The textures of all layers that are shown, ready to be asked.
#[derive(Clone, Debug, Default)]
pub(crate) struct FillTextures {
    layers: BTreeMap<u64, (GraphFill, Textures)>,
    /// What masks are made from.
    masks: BTreeMap<u64, (MaskMeasure, Arc<Measured>)>,
}

impl FillTextures {
    /// Makes what is missing and drops what is no longer shown.
    pub(crate) fn update(&mut self, surface: &Surface, layers: &Layers) -> Result<()> {
        let masks = std::mem::take(&mut self.masks);
        for layer in &layers.stack {
            let Some(MaskSource { by, .. }) = layer.mask_source else { continue };
            // Layers that were copied share it.
            let measured = masks.values().chain(self.masks.values()).find(|(known, _)| *known == by);
            let measured = match measured {
                Some((_, measured)) => Arc::clone(measured),
                None => Arc::new(Measured::new(surface, by)),
            };
            self.masks.insert(layer.id(), (by, measured));
        }
        let mut known = std::mem::take(&mut self.layers);
        for layer in layers.stack.iter().filter(|layer| layer.visible && layer.opacity > 0.0) {
            let LayerContent::Graph(fill) = &layer.content else { continue };
            let made = match known.remove(&layer.id()) {
                Some((before, textures)) if before == *fill => textures,
                _ => {
                    let texture = |name: &Option<String>| {
                        name.as_ref().map(|name| fill.graph.texture(surface, name)).transpose()
                    };
                    let textures = fill.textures.iter().map(texture).collect::<Result<_>>();
                    textures.map_err(|source: Error| {
                        let sentence = format!(
                            "the layer {:?} cannot be shown: {source}; correct its textures or hide it",
                            layer.name
                        );
                        Error::new(source.kind(), sentence).with_source(source)
                    })?
                }
            };
            self.layers.insert(layer.id(), (fill.clone(), made));
        }
        Ok(())
    }

    /// What a layer's mask is made from.
    pub(crate) fn measured(&self, layer: u64) -> Option<&Measured> {
        self.masks.get(&layer).map(|(_, measured)| &**measured)
    }

    /// Values in a rectangle of a page, per channel and texel (transparent elsewhere); `is_hidden` says where none are needed.
    pub(crate) fn values(
        &self,
        surface: &Surface,
        layer: u64,
        map: &TexelPage,
        rect: Rect,
        is_hidden: impl Fn(usize) -> bool,
    ) -> Vec<Vec<Vec4>> {
        let Some((_, textures)) = self.layers.get(&layer) else { return Vec::new() };
        let mut values = vec![Vec::new(); textures.len()];
        for (values, texture) in values.iter_mut().zip(textures) {
            let Some(texture) = texture else { continue };
            values.resize(map.owner.len(), Vec4::ZERO);
            for place in rect.texels() {
                let texel = map.texel(place);
                if map.is_valid(texel) && !is_hidden(texel) {
                    let (triangle, lambda) = (map.triangle(place), map.point(place).lambda);
                    values[texel] = shade(surface, triangle, lambda, |point| texture.evaluate(point));
                }
            }
        }
        values
    }
}

// Folders of looks as an asset keeps them: relative to the asset where they lie with it, so that both can be moved together.

/// Folders above the asset's own within which a look counts as lying with the asset.
const FOLDERS_UP: usize = 1;

/// The folder as it is kept in an asset: relative, with slashes, where it lies in the asset's folder or in the one above that;
/// else absolute.
pub(crate) fn kept_folder(asset: &Path, folder: &Path) -> PathBuf {
    let folder = absolute(folder);
    for (up, base) in home(asset).ancestors().take(1 + FOLDERS_UP).enumerate() {
        // Everything lies below the root.
        if base.parent().is_none() {
            break;
        }
        let Ok(rest) = folder.strip_prefix(base) else { continue };
        let down = rest.components().map(Component::as_os_str).map(|name| name.to_string_lossy());
        let parts: Vec<_> = std::iter::repeat_n("..".into(), up).chain(down).collect();
        return if parts.is_empty() { PathBuf::from(".") } else { PathBuf::from(parts.join("/")) };
    }
    folder
}

/// Refuses a look that an asset keeps if it names files beyond those folders: whoever made the asset must not choose what is read.
///
/// # Errors
/// It names one, and that is not [allowed](input::ReadOptions::allow_outside).
pub(crate) fn check_files(graph: &TextureGraph, asset: &Path) -> Result<()> {
    // What is no look is refused where it is used.
    let Ok(file) = LookFile::parse(&graph.look, &graph.folder.join("look.toml")) else { return Ok(()) };
    let home = home(asset);
    let owner = home.ancestors().take(1 + FOLDERS_UP).last().unwrap_or(&home).join("asset");
    file.texture_files().iter().try_for_each(|name| {
        input::check_inside(&owner, &graph.folder.join(name)).map_err(|_| {
            let (asset, name) = (asset.display(), graph.folder.join(name));
            Error::invalid(format!(
                "{asset} has a layer or a stroke that shows {}, which does not lie with the asset; copy it there, or allow such files \
                 (--allow-outside)",
                name.display()
            ))
        })
    })
}

/// The folder that was kept, absolute.
pub(crate) fn found_folder(asset: &Path, kept: &Path) -> PathBuf {
    if kept == Path::new(".") { home(asset) } else { home(asset).join(kept) }
}

/// The folder of an asset.
fn home(asset: &Path) -> PathBuf {
    absolute(asset).parent().map(Path::to_owned).unwrap_or_default()
}

fn absolute(path: &Path) -> PathBuf {
    if path.as_os_str().is_empty() {
        return std::env::current_dir().unwrap_or_default();
    }
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_show_files_that_lie_with_the_asset() {
        let root = std::env::temp_dir();
        let asset = root.join("assets/a.fan");
        let shown = |folder: &str, image: &str| {
            let look = format!("[textures.a]\nkind = \"image\"\nimage = \"{image}\"\n");
            check_files(&TextureGraph { look, folder: root.join(folder) }, &asset)
        };
        shown("assets", "x.png").unwrap();
        shown("looks", "deep/x.png").unwrap();
        for (folder, image) in [("../far", "x.png"), ("assets", "../../x.png"), ("assets", "/dev/zero")] {
            let sentence = shown(folder, image).unwrap_err().to_string();
            assert!(
                sentence.contains("a.fan has a layer") && sentence.contains("--allow-outside"),
                "{sentence}"
            );
        }
        for mentions in [
            "kind = \"asset\"\nasset = \"/far/x.fan\"",
            "kind = \"volume\"\nslices = [\"../../x.png\"]",
            "kind = \"cube\"\nimage = \"/dev/zero\"",
        ] {
            let graph =
                TextureGraph { look: format!("[textures.a]\n{mentions}\n"), folder: root.join("assets") };
            assert!(
                check_files(&graph, &asset).unwrap_err().to_string().contains("--allow-outside"),
                "{mentions}"
            );
        }
        let look = "[textures.a]\nkind = \"color\"\ncolor = [1.0, 0.0, 0.0]\n".to_owned();
        check_files(&TextureGraph { look, folder: root.join("../far") }, &asset).unwrap();
    }

    #[test]
    fn folders_move_with_the_asset() {
        let root = std::env::temp_dir();
        let at = |path: &str| root.join("project").join(path);
        for (folder, kept) in [("assets", "."), ("assets/looks/a", "looks/a"), ("looks", "../looks")] {
            assert_eq!(kept_folder(&at("assets/a.fan"), &at(folder)), PathBuf::from(kept));
            assert_eq!(
                kept_folder(&at("assets/a.fan"), &found_folder(&at("assets/a.fan"), Path::new(kept))),
                PathBuf::from(kept)
            );
        }
        let moved = root.join("elsewhere/assets/a.fan");
        assert_eq!(found_folder(&moved, Path::new("looks")), root.join("elsewhere/assets/looks"));
        let far = root.join("other");
        assert_eq!(kept_folder(&at("assets/deep/a.fan"), &far), far, "not with the asset");
        assert_eq!(found_folder(&moved, &far), far);
    }
}
