//! Names that stand for textures, materials and objects of the look.

use std::collections::BTreeMap;

use super::check::{Mistake, Reference, ReferenceKind};
use super::error::LookProblem;
use super::suggest::nearest;
use crate::data::Look;

/// Textures that may need each other in a row: evaluation calls them one within the other.
pub(super) const MAX_DEPTH: usize = 64;

/// Checks that every name is defined and no texture needs itself.
pub(super) fn check_names(look: &Look, references: &[Reference]) -> Result<(), Mistake> {
    references.iter().try_for_each(|reference| check_defined(look, reference))?;
    let mut needs: BTreeMap<&str, Vec<&Reference>> = BTreeMap::new();
    for reference in references.iter().filter(|r| r.kind == ReferenceKind::Texture) {
        if let Some(owner) = reference.key.member_of("textures") {
            needs.entry(owner).or_default().push(reference);
        }
    }
    let mut walk = Walk { needs: &needs, path: Vec::new(), depths: BTreeMap::new() };
    needs.keys().try_for_each(|&name| walk.depth(name).map(drop))
}

fn check_defined(look: &Look, reference: &Reference) -> Result<(), Mistake> {
    let known: Vec<&str> = match reference.kind {
        ReferenceKind::Texture => look.textures.keys().map(String::as_str).collect(),
        ReferenceKind::Material => look.materials.keys().map(String::as_str).collect(),
        ReferenceKind::Object => look.object.iter().filter_map(|o| o.name.as_deref()).collect(),
    };
    if known.contains(&reference.name.as_str()) {
        return Ok(());
    }
    let what = match reference.kind {
        ReferenceKind::Texture => "texture",
        ReferenceKind::Material => "material",
        ReferenceKind::Object => "object",
    };
    let nearest = nearest(&reference.name, known.iter().copied());
    let known = known.into_iter().map(str::to_owned).collect();
    Err(mistake(reference, LookProblem::Undefined { what, name: reference.name.clone(), nearest, known }))
}

fn mistake(reference: &Reference, problem: LookProblem) -> Mistake {
    Mistake { key: reference.key.clone(), span: reference.span.clone(), problem: Box::new(problem) }
}

/// A depth-first walk through the textures.
struct Walk<'r> {
    needs: &'r BTreeMap<&'r str, Vec<&'r Reference>>,
    /// From the first texture to the one that is visited.
    path: Vec<&'r str>,
    /// Textures in the longest row from here on, of those that are done.
    depths: BTreeMap<&'r str, usize>,
}

impl<'r> Walk<'r> {
    fn depth(&mut self, name: &'r str) -> Result<usize, Mistake> {
        if let Some(&depth) = self.depths.get(name) {
            return Ok(depth);
        }
        self.path.push(name);
        let mut deepest = 0;
        for &reference in self.needs.get(name).into_iter().flatten() {
            if let Some(start) = self.path.iter().position(|&other| other == reference.name) {
                let circle = self.path[start..].iter().copied().chain([reference.name.as_str()]);
                let circle = circle.map(str::to_owned).collect();
                return Err(mistake(reference, LookProblem::Cycle(circle)));
            }
            let too_deep = || mistake(reference, LookProblem::TooDeep { limit: MAX_DEPTH });
            // Bounds the recursion, too.
            if self.path.len() > MAX_DEPTH {
                return Err(too_deep());
            }
            deepest = deepest.max(self.depth(&reference.name)?);
            if deepest >= MAX_DEPTH {
                return Err(too_deep());
            }
        }
        self.path.pop();
        self.depths.insert(name, deepest + 1);
        Ok(deepest + 1)
    }
}
