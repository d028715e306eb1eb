//! Tensors of a view, as they come.

use crate::client::{Link, Wake};
use crate::control::TensorInfo;
use crate::feed::Feed;
use crate::header::{ABI, Flags, Line, TensorHeader};
use crate::transport::Gated;
use crate::{Error, Stream};
use core::time::Duration;
use iceoryx2::sample::Sample;
use std::rc::Rc;

/// Receives the tensors of a view. Made by [`Client::view`](crate::Client::view).
#[derive(Debug)]
pub struct ViewSubscriber {
    feed: Feed<Line, TensorHeader>,
    cursor: Option<(u64, u64)>,
    lost: u64,
}

impl ViewSubscriber {
    pub(crate) fn open(link: Rc<Link>, stream: Stream, wake: Wake) -> Result<Self, Error> {
        Ok(Self { feed: Feed::open(link, stream, wake)?, cursor: None, lost: 0 })
    }

    /// What its tensors are. A daemon that comes back with another configuration may change it.
    pub fn info(&self) -> Option<&TensorInfo> {
        self.feed.tensor()
    }

    /// The next tensor, waiting for at most `timeout`.
    ///
    /// # Errors
    /// As [`EventSubscriber::recv`](crate::EventSubscriber::recv).
    pub fn recv(&mut self, timeout: Duration) -> Result<Tensor, Error> {
        loop {
            let sample = self.feed.recv(timeout)?;
            if let Some(tensor) = self.account(sample)? {
                return Ok(tensor);
            }
        }
    }

    /// The next tensor, if it is there. Never waits.
    ///
    /// # Errors
    /// As [`EventSubscriber::try_recv`](crate::EventSubscriber::try_recv).
    pub fn try_recv(&mut self) -> Result<Option<Tensor>, Error> {
        while let Some(sample) = self.feed.try_recv()? {
            if let Some(tensor) = self.account(sample)? {
                return Ok(Some(tensor));
            }
        }
        Ok(None)
    }

    /// Windows lost so far: published while this client was subscribed, and overwritten before it read them.
    pub const fn lost(&self) -> u64 {
        self.lost
    }

    /// What it is subscribed to.
    pub fn stream(&self) -> &Stream {
        self.feed.stream()
    }

    fn account(&mut self, sample: Sample<Gated, [Line], TensorHeader>) -> Result<Option<Tensor>, Error> {
        let header = *sample.user_header();
        if header.abi != ABI {
            let wire = |abi: u32| format!("wire version {abi}");
            return Err(Error::AbiMismatch { ours: wire(ABI), theirs: wire(header.abi) });
        }
        if header.bytes() > size_of_val(sample.payload()) {
            return Err(Error::Transport { message: "a tensor is larger than its memory".into() });
        }
        let (changed, lost_before) = match self.cursor {
            None => (false, 0),
            Some((generation, _)) if header.generation < generation => return Ok(None),
            Some((generation, _)) if header.generation > generation => (true, 0),
            Some((_, next)) => (false, header.sequence.saturating_sub(next)),
        };
        self.cursor = Some((header.generation, header.sequence.saturating_add(1)));
        self.lost += lost_before;
        Ok(Some(Tensor { sample, lost_before, generation_changed: changed }))
    }
}

/// One window of a view, in shared memory for as long as it is held: at most 2 at once.
#[derive(Debug)]
pub struct Tensor {
    sample: Sample<Gated, [Line], TensorHeader>,
    lost_before: u64,
    generation_changed: bool,
}

impl Tensor {
    /// Its header.
    pub fn header(&self) -> &TensorHeader {
        self.sample.user_header()
    }

    /// Its elements as bytes, row-major: channels, rows, columns.
    pub fn bytes(&self) -> &[u8] {
        let bytes: &[u8] = bytemuck::cast_slice(self.sample.payload());
        bytes.get(..self.header().bytes()).unwrap_or_default()
    }

    /// Its elements as `P`; none if they have another size.
    ///
    /// ```no_run
    /// # fn example(tensor: lobula_client::Tensor) {
    /// let elements: &[f32] = tensor.elements().unwrap_or_default();
    /// # }
    /// ```
    pub fn elements<P: bytemuck::Pod>(&self) -> Option<&[P]> {
        (size_of::<P>() == self.header().dtype()?.bytes())
            .then(|| bytemuck::try_cast_slice(self.bytes()).ok())?
    }

    /// Windows that were published between the one before and this, and overwritten before they were read.
    pub const fn lost_before(&self) -> u64 {
        self.lost_before
    }

    /// Whether the daemon was started anew since the tensor before.
    pub const fn generation_changed(&self) -> bool {
        self.generation_changed
    }

    /// Whether the source has ended: the last window of its generation.
    pub fn is_end(&self) -> bool {
        self.header().flags().contains(Flags::END)
    }
}
