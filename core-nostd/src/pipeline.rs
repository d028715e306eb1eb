//! Pipelines with static types: a tuple of filters is a filter, as firmware wants it. On the host a chain of the same
//! filters ([`chain`](crate::chain)) gives the same bits.

use crate::{Block, Event, Filter, WrongGeometry};

macro_rules! tuple {
    ($($stage:ident $index:tt),+) => {
        /// Each filter sees what the ones before it kept.
        impl<$($stage: Filter),+> Filter for ($($stage,)+) {
            fn advance(&mut self, now: u64) {
                $(self.$index.advance(now);)+
            }

            fn keep(&mut self, event: Event) -> bool {
                true $(&& self.$index.keep(event))+
            }

            fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
                $(self.$index.retain(block)?;)+
                Ok(block.len())
            }
        }
    };
}

tuple!(A 0);
tuple!(A 0, B 1);
tuple!(A 0, B 1, C 2);
tuple!(A 0, B 1, C 2, D 3);
tuple!(A 0, B 1, C 2, D 3, E 4);
tuple!(A 0, B 1, C 2, D 3, E 4, F 5);
tuple!(A 0, B 1, C 2, D 3, E 4, F 5, G 6);
tuple!(A 0, B 1, C 2, D 3, E 4, F 5, G 6, H 7);
