//! The publishing end of a stream: loan, write once, send, wake.

use super::{DataService, Gated, create_services, free_bytes, reserve};
use crate::{Error, Qos, Root, Stream};
use core::fmt::Debug;
use core::sync::atomic::{AtomicBool, Ordering};
use iceoryx2::node::Node;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::port::{BackpressureAction, BackpressureInfo, LoanError};
use iceoryx2::prelude::{BackpressureStrategy, ZeroCopySend};
use iceoryx2::sample_mut::SampleMut;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// How long a lossless stream waits for its slowest client: until it reads, is known to be gone, or all stops.
#[derive(Debug, Default)]
pub struct Patience {
    given_up: AtomicBool,
    gone: Mutex<Vec<u128>>,
}

impl Patience {
    /// Waits no longer for anybody.
    pub fn give_up(&self) {
        self.given_up.store(true, Ordering::Release);
    }

    /// Waits no longer for the client with this port.
    pub fn forget(&self, port: u128) {
        self.gone().push(port);
    }

    /// Waits for the client with this port again.
    pub fn remember(&self, port: u128) {
        self.gone().retain(|gone| *gone != port);
    }

    fn gone(&self) -> MutexGuard<'_, Vec<u128>> {
        self.gone.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn decide(&self, info: &BackpressureInfo) -> BackpressureAction {
        let hopeless = self.given_up.load(Ordering::Acquire) || self.gone().contains(&info.receiver_port_id);
        if hopeless { BackpressureAction::DiscardData } else { BackpressureAction::Retry }
    }
}

/// Memory on loan for one packet: header and payload, written in place.
pub type Loan<T, H> = SampleMut<Gated, [T], H>;

/// The publishing end of a stream of `T` with header `H`. Belongs to one thread.
#[derive(Debug)]
pub struct Outlet<T, H>
where
    T: Debug + ZeroCopySend + 'static,
    H: Debug + ZeroCopySend + 'static,
{
    publisher: Publisher<Gated, [T], H>,
    notifier: Notifier<Gated>,
    service: DataService<T, H>,
}

impl<T, H> Outlet<T, H>
where
    T: Debug + ZeroCopySend + bytemuck::Pod,
    H: Debug + Default + ZeroCopySend + bytemuck::Pod,
{
    /// Opens the stream for packets of at most `len_max` elements, and takes all of its memory, so that no write to it
    /// can fail later, whatever else fills the file system. A lossless stream needs `patience`.
    pub fn create(
        node: &Node<Gated>,
        root: &Root,
        stream: &Stream,
        camera: &str,
        len_max: usize,
        patience: Option<Arc<Patience>>,
    ) -> Result<Self, Error> {
        let qos = Qos::of(stream);
        let (need, free) = (qos.bytes(len_max * size_of::<T>()), free_bytes(root)?);
        if need > free {
            return Err(Error::NoSpace { root: root.clone(), need, free });
        }
        let (service, wake) = create_services::<T, H>(node, stream, camera)?;
        let builder = service
            .publisher_builder()
            .initial_max_slice_len(len_max)
            .max_loaned_samples(qos.loans_max)
            .override_sample_preallocation(move |_| qos.packets());
        let builder = match patience {
            Some(patience) => builder
                .backpressure_strategy(BackpressureStrategy::RetryUntilDelivered)
                .set_backpressure_handler(move |info| patience.decide(info)),
            None => builder.backpressure_strategy(BackpressureStrategy::DiscardData),
        };
        let publisher =
            builder.create().map_err(|error| Error::transport(&format!("publisher of {stream}"), error))?;
        let notifier = wake
            .notifier_builder()
            .create()
            .map_err(|error| Error::transport(&format!("wake-up of {stream}"), error))?;
        reserve(root, publisher.id().value())?;
        Ok(Self { publisher, notifier, service })
    }

    /// Memory for a packet of `len` elements; its bytes are whatever was there. None: all is in use.
    #[allow(unsafe_code)] // iceoryx2 asks for a promise where Pod already gives it
    pub fn loan(&self, len: usize) -> Result<Option<Loan<T, H>>, Error> {
        match self.publisher.loan_slice_uninit(len) {
            // SAFETY: the memory is a file mapping, which the kernel has zeroed or an earlier packet has written, and
            // any bits are a valid `T` and `H` (both are Pod).
            Ok(sample) => Ok(Some(unsafe { sample.assume_init() })),
            Err(LoanError::OutOfMemory | LoanError::ExceedsMaxLoans) => Ok(None),
            Err(error) => Err(Error::transport("loan of shared memory", error)),
        }
    }

    /// Hands a packet to every client and wakes those that sleep; returns how many clients got it.
    pub fn send(&self, loan: Loan<T, H>) -> Result<usize, Error> {
        let clients = loan.send().map_err(|error| Error::transport("send", error))?;
        // A client that cannot be woken reads at its next look; that is no failure of this packet.
        let _ = self.notifier.notify();
        Ok(clients)
    }

    /// Gives clients that came since the last packet what they are due (the last tensor), and lets go of those gone.
    pub fn update(&self) {
        let _ = self.publisher.update_connections();
    }

    /// Number of clients that have the stream open.
    pub fn clients(&self) -> usize {
        use iceoryx2::prelude::PortFactory;
        self.service.dynamic_config().number_of_subscribers()
    }
}
