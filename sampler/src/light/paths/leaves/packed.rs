//! Leaf sides in the layout of programs: `shaders/shared/lit_leaves.wgsl`.

use argus_shaders::layout::surface_light::LeafGrid;
use glam::Vec3;
use rayon::prelude::*;

use super::Leaves;
use crate::lit_leaves::PackedLeaves;
use crate::resident::octahedral;

/// Key of a slot without a leaf.
const NO_LEAF: u32 = u32::MAX;

impl Leaves {
    /// All leaves, with the radiance that each side reflects; without any, sides are black.
    pub(in crate::light) fn packed(&self, radiance: &[Vec3]) -> PackedLeaves {
        let front = |triangle: u32| octahedral(self.front(triangle).unwrap_or(Vec3::Y));
        let sides = self.sides.iter().enumerate().flat_map(|(index, side)| {
            let front = f32::from(u8::from(side.is_front));
            let radiance = radiance.get(index).copied().unwrap_or_default();
            [side.normal.extend(front).to_array(), radiance.extend(0.0).to_array()]
        });
        let (low, cell, growth, [inner, outer]) = self.grid.parameters();
        PackedLeaves {
            center: self.center,
            grid: LeafGrid { low: low.to_array(), cell, eye: [0.0; 3], growth, inner, outer, _pad: [0; 2] },
            table: self.packed_table(),
            sides: sides.collect(),
            fronts: (0..self.triangles.len() as u32).into_par_iter().map(front).collect(),
            first_of_instance: self.first_of_instance.clone(),
        }
    }

    /// Leaves by the Morton number of their cell, with open addressing. At least half of the slots are free.
    fn packed_table(&self) -> Vec<[u32; 4]> {
        let mut table = vec![[NO_LEAF, 0, 0, 0]; (self.keys.len() * 2).max(2).next_power_of_two()];
        let mask = table.len() - 1;
        for (leaf, &key) in self.keys.iter().enumerate() {
            let mut slot = slot_of(key) as usize & mask;
            while table[slot][0] != NO_LEAF {
                slot = (slot + 1) & mask;
            }
            let sides = self.sides_in(leaf as u32);
            table[slot] = [key, sides.start, sides.len() as u32, 0];
        }
        table
    }
}

/// The first slot at which a Morton number is looked for, as in the program.
fn slot_of(key: u32) -> u32 {
    let mixed = (key ^ key >> 15).wrapping_mul(0x9e37_79b1);
    mixed ^ mixed >> 16
}
