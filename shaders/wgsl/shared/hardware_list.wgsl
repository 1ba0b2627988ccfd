// The list of clusters that the hardware draws: it lies behind the compute rasterizer's. Needs the
// bindings `view`, `args` and `draw_lists`.
#import types

// Visible index of a cluster of the list.
fn hardware_index(drawn_index: u32) -> u32 {
    return draw_lists[view.cluster_capacity + args.first_hardware + drawn_index];
}
