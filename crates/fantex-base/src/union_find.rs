//! Disjoint sets (R. E. Tarjan, "Efficiency of a Good But Not Linear Set Union Algorithm", 1975), with path halving. The smallest member
//! stands for a set, so that results do not depend on the order of unions; that is why this is not a crate's.

/// A partition of `0..n`.
#[derive(Clone, Debug, Default)]
pub struct UnionFind(Vec<u32>);

impl UnionFind {
    /// Every element on its own.
    pub fn new(elements: usize) -> Self {
        Self((0..elements as u32).collect())
    }

    /// Every element on its own again, in the memory that is there.
    pub fn reset(&mut self, elements: usize) {
        self.0.clear();
        self.0.extend(0..elements as u32);
    }

    /// The smallest element of a set.
    #[inline]
    pub fn find(&mut self, mut element: u32) -> u32 {
        let parents = &mut self.0;
        while parents[element as usize] != element {
            parents[element as usize] = parents[parents[element as usize] as usize];
            element = parents[element as usize];
        }
        element
    }

    /// Joins the sets of two elements; false where they are one already.
    #[inline]
    pub fn union(&mut self, a: u32, b: u32) -> bool {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
        a != b
    }

    /// Numbers the sets without gaps, in the order of their smallest elements. `numbers` becomes the number of every element's set; returns how
    /// many sets there are.
    pub fn number(&self, numbers: &mut Vec<u32>) -> usize {
        numbers.clear();
        numbers.reserve(self.0.len());
        let mut count = 0;
        for (element, &parent) in (0u32..).zip(&self.0) {
            // A parent comes before its children.
            numbers.push(if parent == element { count } else { numbers[parent as usize] });
            count += u32::from(parent == element);
        }
        count as usize
    }
}
