//! The Pico's queue of bytes, which needs no Pico.

#![allow(missing_docs, unreachable_pub, clippy::new_without_default, reason = "of another crate")]

#[path = "../pico/src/queue.rs"]
mod queue;

use queue::Queue;

#[test]
fn packets_pass_whole_and_in_order_or_not_at_all() {
    let mut queue = Queue::new();
    let (mut put, mut taken) = (Vec::new(), Vec::new());
    let mut refused = 0;
    for round in 0..500_usize {
        let packet = vec![(round % 251) as u8; 1 + round * 7 % 73];
        let waiting = put.len() - taken.len();
        queue.put_whole(&packet);
        if waiting + packet.len() <= 1024 {
            put.extend_from_slice(&packet);
        } else {
            refused += 1;
        }
        // A host that takes a little, and now and then nothing.
        if round % 50 < 40 {
            let count = queue.next_bytes().len().min(round % 64);
            taken.extend_from_slice(&queue.next_bytes()[..count]);
            queue.drop_first(count);
        }
    }
    while !queue.next_bytes().is_empty() {
        taken.extend_from_slice(queue.next_bytes());
        let count = queue.next_bytes().len();
        queue.drop_first(count);
    }
    assert!(refused > 10 && taken.len() > 10_000, "{refused} {}", taken.len());
    assert_eq!(taken, put);
}
