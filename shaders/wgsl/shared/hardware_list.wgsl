// The list of clusters that the hardware draws: it lies behind the compute rasterizer's. Needs the
// bindings `view`, `args` and `draw_lists`.
#import types

// Visible index of a cluster of the list. Where the order of drawing decides ties, the list is that
// of all visible clusters, by index.
fn hardware_index(drawn_index: u32) -> u32 {
    let place = args.first_hardware + drawn_index;
    if (view.flags & VIEW_FLAG_ORDERED) != 0u {
        return place;
    }
    return draw_lists[view.cluster_capacity + place];
}
