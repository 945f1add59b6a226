//! Lists that few groups have.

use std::collections::HashMap;

/// A list per group, most of them empty. Asking a group that has none costs a look at one byte.
#[derive(Clone, Debug)]
pub(crate) struct SparseLists<T> {
    lists: HashMap<u32, Vec<T>>,
    has_list: Vec<bool>,
}

impl<T> SparseLists<T> {
    /// All lists are empty.
    pub(crate) fn new(group_count: usize) -> Self {
        Self { lists: HashMap::new(), has_list: vec![false; group_count] }
    }

    #[inline]
    pub(crate) fn get(&self, group: u32) -> &[T] {
        if !self.has_list[group as usize] {
            return &[];
        }
        self.lists.get(&group).map_or(&[], Vec::as_slice)
    }

    /// Replaces a list; returns the last one.
    pub(crate) fn set(&mut self, group: u32, list: Vec<T>) -> Vec<T> {
        let has_list = !list.is_empty();
        let had_list = std::mem::replace(&mut self.has_list[group as usize], has_list);
        let last = match (had_list, has_list) {
            (false, false) => None,
            (_, true) => self.lists.insert(group, list),
            (true, false) => self.lists.remove(&group),
        };
        last.unwrap_or_default()
    }
}
