// The queues of hierarchy nodes: two halves that swap with each level, then the rejected items.
// Needs the bindings `view`, `counters` and `node_queues`.
#import types

// Of a queued node: it is hidden, and so is all below it. Its pages are asked for after all others.
const HIDDEN_FLAG: u32 = 0x80000000u;
// A rejected item whose instance was rejected whole; others name node * 8 + child.
const WHOLE_INSTANCE: u32 = 0xffffffffu;

// Puts an item on the list of rejected ones; false where it is full: then the item counts as
// visible.
fn reject_node(item: NodeItem) -> bool {
    let place = atomicAdd(&counters.rejected_nodes, 1u);
    if place >= view.node_capacity {
        return false;
    }
    node_queues[2u * view.node_capacity + place] = item;
    return true;
}

fn append_node(item: NodeItem) {
    let place = atomicAdd(&counters.next_node_count, 1u);
    if place < view.node_capacity {
        node_queues[(1u - counters.node_half) * view.node_capacity + place] = item;
    }
}
