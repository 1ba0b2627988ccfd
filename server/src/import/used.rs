//! Used vertices: what triangles take of a vertex array, numbered anew.

/// The vertices that some triangles use.
pub(super) struct Used {
    /// Numbers in the source, each once where nothing but the source parts vertices.
    pub(super) ascending: Vec<u32>,
    /// For each of them its new number; `None` where they keep their order.
    slots: Option<Vec<u32>>,
}

impl Used {
    /// Keeps the source's order.
    pub(super) fn in_order(ascending: Vec<u32>) -> Self {
        Self {
            ascending,
            slots: None,
        }
    }

    /// Of a list of vertices, in which the same may stand more than once: each place is a new
    /// number.
    pub(super) fn of_vertices(vertices: &[u32]) -> Self {
        let mut places: Vec<u32> = (0..vertices.len() as u32).collect();
        places.sort_by_key(|&place| vertices[place as usize]);
        let vertex = |&place: &u32| vertices[place as usize];
        Self {
            ascending: places.iter().map(vertex).collect(),
            slots: Some(places),
        }
    }

    /// Points `triangles` at new numbers, given in the order of first use. At most 2^32 - 1 corners.
    ///
    /// Takes memory for the corners, not for the source.
    pub(super) fn by_first_use(triangles: &mut [[u32; 3]]) -> Self {
        /// A table over the span of the numbers is the faster way while it is not much longer than the corners.
        const TABLE_PER_CORNER: usize = 8;
        let corners = || triangles.iter().flatten().copied();
        let (Some(least), Some(most)) = (corners().min(), corners().max()) else {
            return Self::in_order(Vec::new());
        };
        let span = (most - least) as usize + 1;
        match span / TABLE_PER_CORNER <= triangles.len() * 3 {
            true => Self::by_table(triangles, least, span),
            false => Self::by_sorting(triangles),
        }
    }

    fn by_table(triangles: &mut [[u32; 3]], least: u32, span: usize) -> Self {
        const FREE: u32 = u32::MAX;
        let mut number_of = vec![FREE; span];
        let mut next = 0;
        for corner in triangles.iter_mut().flatten() {
            let number = &mut number_of[(*corner - least) as usize];
            if *number == FREE {
                *number = next;
                next += 1;
            }
            *corner = *number;
        }
        let mut ascending = Vec::with_capacity(next as usize);
        let mut slots = Vec::with_capacity(next as usize);
        for (vertex, number) in (least..).zip(number_of) {
            if number != FREE {
                ascending.push(vertex);
                slots.push(number);
            }
        }
        Self {
            ascending,
            slots: Some(slots),
        }
    }

    fn by_sorting(triangles: &mut [[u32; 3]]) -> Self {
        // The vertex above, the corner below: equal vertices stand together, their first corner first.
        let mut by_vertex: Vec<u64> = (0u64..)
            .zip(triangles.iter().flatten())
            .map(|(corner, &vertex)| u64::from(vertex) << 32 | corner)
            .collect();
        by_vertex.sort_unstable();
        let mut ascending: Vec<u32> = Vec::new();
        let mut firsts: Vec<(u32, u32)> = Vec::new();
        for &entry in &by_vertex {
            let (vertex, corner) = ((entry >> 32) as u32, entry as u32);
            if ascending.last() != Some(&vertex) {
                firsts.push((corner, ascending.len() as u32));
                ascending.push(vertex);
            }
        }
        firsts.sort_unstable();
        let mut slots = vec![0; ascending.len()];
        for (slot, &(_, place)) in (0u32..).zip(&firsts) {
            slots[place as usize] = slot;
        }
        let mut place = 0;
        for &entry in &by_vertex {
            let (vertex, corner) = ((entry >> 32) as u32, entry as u32 as usize);
            place += usize::from(ascending[place] != vertex);
            triangles[corner / 3][corner % 3] = slots[place];
        }
        Self {
            ascending,
            slots: Some(slots),
        }
    }

    pub(super) fn len(&self) -> usize {
        self.ascending.len()
    }

    /// The new number of `ascending[place]`.
    pub(super) fn slot(&self, place: usize) -> usize {
        match &self.slots {
            Some(slots) => slots[place] as usize,
            None => place,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Used;

    #[test]
    fn both_ways_number_by_first_use() {
        let triangles = [[70, 50, 60], [50, 90, 70], [51, 50, 90]];
        let mut by_table = triangles;
        let mut by_sorting = triangles;
        let table = Used::by_table(&mut by_table, 50, 41);
        let sorting = Used::by_sorting(&mut by_sorting);
        assert_eq!(by_table, [[0, 1, 2], [1, 3, 0], [4, 1, 3]]);
        assert_eq!(by_table, by_sorting);
        assert_eq!(table.ascending, [50, 51, 60, 70, 90]);
        assert_eq!(table.ascending, sorting.ascending);
        for place in 0..5 {
            assert_eq!(table.slot(place), sorting.slot(place));
        }
        assert_eq!(table.slot(0), 1);
    }
}
