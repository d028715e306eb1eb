//! The one kind of iceoryx2 service of Lobula: every piece of it is a file under the root directory.
//!
//! Stock iceoryx2 puts segments into POSIX shared memory, where nothing but the user id decides who may read, and
//! leaves some behind. Here all of it lies under one directory that the daemon makes, so that the directory's mode is
//! the gate, and nothing is ever found outside of it.

use core::fmt::Debug;
use iceoryx2::prelude::ZeroCopySend;
use iceoryx2::service::ipc;
use iceoryx2_bb_elementary_traits::testing::abandonable::Abandonable;
use iceoryx2_bb_lock_free::mpmc::counting_bit_set::RelocatableCountingBitSet;
use iceoryx2_cal::dynamic_storage::file::Storage;
use iceoryx2_cal::event::trigger::State;
use iceoryx2_cal::event::trigger::unix_datagram_socket::GenericUnixDatagramSocketTrigger;
use iceoryx2_cal::resizable_shared_memory::dynamic::DynamicMemory;
use iceoryx2_cal::shared_memory::file::Memory;
use iceoryx2_cal::shm_allocator::bump_allocator::BumpAllocator;
use iceoryx2_cal::shm_allocator::pool_allocator::PoolAllocator;

/// The service type of every port of Lobula.
#[derive(Clone, Debug)]
pub struct Gated {}

impl iceoryx2::service::Service for Gated {
    type StaticStorage = iceoryx2_cal::static_storage::recommended::Ipc;
    type ConfigSerializer = iceoryx2_cal::serialize::recommended::Recommended;
    type PersistentDynamicStorage<T: Debug + Send + Sync + ZeroCopySend + 'static> = Storage<T>;
    type DynamicStorage<T: Debug + Send + Sync + ZeroCopySend + 'static> = Storage<T>;
    type Bag = iceoryx2_cal::bag::recommended::Recommended;
    type UniqueId = <ipc::Service as iceoryx2::service::Service>::UniqueId;
    type ServiceNameHasher = iceoryx2_cal::hash::recommended::Recommended;
    type SharedMemory = Memory<PoolAllocator>;
    type ResizableSharedMemory = DynamicMemory<PoolAllocator, Memory<PoolAllocator>>;
    type Connection = iceoryx2_cal::zero_copy_connection::file::Connection;
    type Event = GenericUnixDatagramSocketTrigger<
        RelocatableCountingBitSet,
        Storage<State<RelocatableCountingBitSet, ()>>,
    >;
    type Monitoring = iceoryx2_cal::monitoring::recommended::Ipc;
    type Reactor = iceoryx2_cal::reactor::recommended::Ipc;
    type ArcThreadSafetyPolicy<T: Send + Debug + Abandonable> =
        iceoryx2_cal::arc_sync_policy::single_threaded::SingleThreaded<T>;
    type BlackboardMgmt<K: Send + Sync + Debug + ZeroCopySend + 'static> = Storage<K>;
    type BlackboardPayload = Memory<BumpAllocator>;
}

impl iceoryx2::service::internal::ServiceInternal<Self> for Gated {}
