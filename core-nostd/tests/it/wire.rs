//! Every wire format under the laws of the core.

use lobula_core::wire::{Kernel, WordOrder, evt2, evt3, evt4, evt21};

mod decoders {
    use super::*;

    chunk_invariance!(decoder evt2_words, evt2::Decoder::new, encoded by evt2::Encoder::new());
    chunk_invariance!(decoder evt21_words, |geometry| evt21::Decoder::new(geometry, WordOrder::Little),
        encoded by evt21::Encoder::new(WordOrder::Little));
    chunk_invariance!(decoder evt21_legacy, |geometry| evt21::Decoder::new(geometry, WordOrder::Legacy),
        encoded by evt21::Encoder::new(WordOrder::Legacy));
    chunk_invariance!(decoder evt2_portable, |geometry| evt2::Decoder::with_kernel(geometry, Kernel::Portable),
        encoded by evt2::Encoder::new());
    chunk_invariance!(decoder evt21_portable,
        |geometry| evt21::Decoder::with_kernel(geometry, WordOrder::Little, Kernel::Portable),
        encoded by evt21::Encoder::new(WordOrder::Little));
    chunk_invariance!(decoder evt3_words, evt3::Decoder::new, encoded by evt3::Encoder::new());
    chunk_invariance!(decoder evt4_words, evt4::Decoder::new, encoded by evt4::Encoder::new());
}

mod encoders {
    use super::*;

    chunk_invariance!(encoder evt2_words, evt2::Encoder::new);
    chunk_invariance!(encoder evt21_words, || evt21::Encoder::new(WordOrder::Little));
    chunk_invariance!(encoder evt21_legacy, || evt21::Encoder::new(WordOrder::Legacy));
    chunk_invariance!(encoder evt3_words, evt3::Encoder::new);
    chunk_invariance!(encoder evt4_words, evt4::Encoder::new);
}
