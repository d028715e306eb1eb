//! What the tests share: where the data is, starting daemons, counting allocator.
