//! The views' thread: owns all ports of views. Packets in, tensors out, drawn in shared memory itself.
//!
//! A surface takes milliseconds to render, so it has a thread of its own, behind a ring. Where the ring is full the
//! views miss a packet, which is counted; the events never wait for a view, but in a lossless replay.

use crate::clock;
use crate::publish::view_stream;
use crate::shared::{Shared, ViewCounts};
use core::sync::atomic::{AtomicU64, Ordering};
use core::time::Duration;
use iceoryx2::node::Node;
use lobula_client::control::TensorInfo;
use lobula_client::transport::{self, Gated, Loan, Outlet};
use lobula_client::{Error, Flags, Line, PACKET_EVENTS_MAX, PacketHeader, Root, Stamps, TensorHeader};
use lobula_core::chain::{Canvas, View, ViewSpec};
use lobula_core::{Closed, Event, Geometry, Span, Window, ring};
use std::sync::Arc;
use std::thread::{self, Thread};

/// Packets between the pipeline and the views: 64 ms of them.
const SLOTS: usize = 64;
/// Longest wait of the thread before it looks after clients that came.
const NAP: Duration = Duration::from_millis(20);

/// What goes with the events of a packet.
#[derive(Clone, Copy, Debug, Default)]
pub struct Handed {
    /// Anchor of its events' times.
    pub t_first: u64,
    /// Stream time at its end.
    pub t_last: u64,
    /// Events published up to its end.
    pub published: u64,
    /// Host times.
    pub stamps: Stamps,
    /// Properties.
    pub flags: Flags,
}

/// The end that the pipeline's thread fills.
pub struct ViewInlet {
    producer: ring::Producer<ring::Shared<Handed, Event>>,
    views: Thread,
    gap: bool,
}

/// The end that the views' thread empties.
pub type ViewArrivals = ring::Consumer<ring::Shared<Handed, Event>>;

/// The ring between them, as the pipeline's end still without its thread, and the views' end.
pub fn ring() -> (ring::Producer<ring::Shared<Handed, Event>>, ViewArrivals) {
    ring::Shared::new(SLOTS, PACKET_EVENTS_MAX)
}

impl ViewInlet {
    /// The end that wakes `views`.
    pub fn new(producer: ring::Producer<ring::Shared<Handed, Event>>, views: Thread) -> Self {
        Self { producer, views, gap: false }
    }

    /// Hands a packet on. Where the ring is full the views miss it; a lossless replay waits, and so does the end, for
    /// which the views wait, also when all stops.
    pub fn push(&mut self, header: &PacketHeader, events: &[Event], shared: &Shared) {
        let end = header.flags().contains(Flags::END);
        let must = || end || (shared.lossless && !shared.is_stopping());
        while self.producer.ring().len() >= self.producer.ring().count() && must() {
            self.views.unpark();
            thread::park_timeout(Duration::from_micros(200));
        }
        let gap = if self.gap { Flags::GAP } else { Flags::default() };
        let handed = Handed {
            t_first: header.t_first,
            t_last: header.t_last,
            published: header.events.published,
            stamps: header.stamps,
            flags: header.flags() | gap,
        };
        self.gap = self.producer.try_push(handed, events).is_err();
        if self.gap {
            shared.views_missed.fetch_add(1, Ordering::Relaxed);
        }
        self.views.unpark();
    }
}

/// What a view's tensors are.
pub fn tensor_info(view: &View, spec: &ViewSpec) -> TensorInfo {
    let shape = view.shape();
    let extent = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    TensorInfo {
        dtype: view.dtype(),
        shape: [extent(shape.channels), extent(shape.height), extent(shape.width)],
        period_us: u64::from(spec.period_us),
        stride_us: u64::from(spec.stride_us.unwrap_or(spec.period_us)),
    }
}

/// All views of a camera.
pub struct Views {
    shared: Arc<Shared>,
    views: Vec<(View, Easel)>,
    _node: Node<Gated>,
}

impl Views {
    /// Opens the streams of the views. Settings have been checked with the configuration.
    pub fn create(root: &Root, shared: &Arc<Shared>, specs: &[ViewSpec]) -> Result<Self, Error> {
        let node = transport::node(root, "lobulad-views")?;
        let mut views = Vec::new();
        for (index, spec) in specs.iter().enumerate() {
            let view = View::try_new(spec, shared.geometry)
                .map_err(|error| Error::Invalid { message: format!("view {:?}: {error}", spec.name) })?;
            let stream = view_stream(&spec.name, shared.lossless);
            let patience = shared.lossless.then(|| shared.patience.clone());
            let lines = Line::needed(view.len_bytes());
            let outlet = Outlet::create(&node, root, &stream, &shared.camera, lines, patience)?;
            let easel = Easel::new(outlet, &view, spec, shared.clone(), index);
            views.push((view, easel));
        }
        Ok(Self { shared: shared.clone(), views, _node: node })
    }

    /// The thread: until the stream has ended and all stops.
    pub fn run(mut self, mut arrivals: ViewArrivals, pipeline: &Thread) {
        loop {
            let Some(packet) = arrivals.pop() else {
                thread::park_timeout(NAP);
                if arrivals.ring().is_empty() {
                    self.update();
                }
                continue;
            };
            let handed = packet.header();
            self.draw(&handed, packet.elements());
            drop(packet);
            pipeline.unpark();
            if handed.flags.contains(Flags::END) {
                break;
            }
        }
        while !self.shared.is_stopping() {
            thread::park_timeout(NAP);
            self.update();
        }
    }

    fn draw(&mut self, handed: &Handed, events: &[Event]) {
        let Handed { t_first, t_last, .. } = *handed;
        let span = Span { t_first, t_last, geometry: self.shared.geometry, events };
        for (view, easel) in &mut self.views {
            easel.look_at(handed);
            // The view was made for this geometry and the easel lends what it asks for, so that neither can fail.
            let _ = view.push(span, easel);
            if handed.flags.contains(Flags::END) {
                easel.end_at = Some(t_last);
                let _ = view.finish(t_last, easel);
                easel.tell_end();
            } else {
                let _ = view.advance(t_last, easel);
            }
            easel.count(view);
        }
    }

    fn update(&self) {
        for (_, easel) in &self.views {
            easel.outlet.update();
        }
    }
}

/// Where one view draws: a sample on loan.
struct Easel {
    outlet: Outlet<Line, TensorHeader>,
    shared: Arc<Shared>,
    index: usize,
    info: TensorInfo,
    len_bytes: usize,
    loan: Option<Loan<Line, TensorHeader>>,
    handed: Handed,
    sequence: u64,
    /// Windows for which there was no memory.
    unlent: u64,
    late: u64,
    /// Since when the view has seen every event, in stream time.
    state_since: Option<u64>,
    /// Windows that end after this are the last.
    end_at: Option<u64>,
    ended: bool,
}

impl Easel {
    fn new(
        outlet: Outlet<Line, TensorHeader>,
        view: &View,
        spec: &ViewSpec,
        shared: Arc<Shared>,
        index: usize,
    ) -> Self {
        Self {
            outlet,
            shared,
            index,
            info: tensor_info(view, spec),
            len_bytes: view.len_bytes(),
            loan: None,
            handed: Handed::default(),
            sequence: 0,
            unlent: 0,
            late: 0,
            state_since: None,
            end_at: None,
            ended: false,
        }
    }

    /// The next pieces come from this packet.
    fn look_at(&mut self, handed: &Handed) {
        if handed.flags.contains(Flags::GAP) || handed.flags.contains(Flags::CLOCK_STEP) {
            self.state_since = None;
        }
        self.state_since.get_or_insert(handed.t_first);
        self.handed = *handed;
    }

    /// The stream has ended: if no window could tell, an empty tensor does.
    fn tell_end(&mut self) {
        if self.ended {
            return;
        }
        let Ok(Some(mut loan)) = self.outlet.loan(0) else { return };
        *loan.user_header_mut() =
            TensorHeader { shape: [0; 3], ..self.header(Window { t0: 0, t1: 0 }, 0, true) };
        self.send(loan);
    }

    fn header(&self, window: Window, events: u64, end: bool) -> TensorHeader {
        let flags = Flags(self.handed.flags.0 & !Flags::END.0);
        let Geometry { width, height } = self.shared.geometry;
        TensorHeader {
            flags: if end { flags | Flags::END } else { flags }.0,
            dtype: self.info.dtype as u32,
            generation: self.shared.generation,
            sequence: self.sequence,
            shape: self.info.shape,
            t0: window.t0,
            t1: window.t1,
            state_since: self.state_since.unwrap_or_default(),
            events,
            late: self.late,
            skipped: self.counts().map_or(0, |counts| counts.skipped.load(Ordering::Relaxed)),
            published: self.handed.published,
            stamps: Stamps { published_ns: clock::now_ns(), ..self.handed.stamps },
            width,
            height,
            ..TensorHeader::default()
        }
    }

    fn send(&mut self, loan: Loan<Line, TensorHeader>) {
        match self.outlet.send(loan) {
            Ok(_) => self.sequence += 1,
            Err(error) => self.shared.degrade(format!("tensors cannot be sent: {error}")),
        }
    }

    fn counts(&self) -> Option<&ViewCounts> {
        self.shared.views.get(self.index)
    }

    fn count(&self, view: &View) {
        let Some(counts) = self.counts() else { return };
        let set = |counter: &AtomicU64, value: u64| counter.store(value, Ordering::Relaxed);
        set(&counts.published, self.sequence);
        set(&counts.skipped, self.unlent + view.skipped());
        set(&counts.late, view.late());
        set(&counts.overflowed, view.overflowed());
    }
}

impl Canvas for Easel {
    fn begin(&mut self, _: Window) {
        self.loan = match self.outlet.loan(Line::needed(self.len_bytes)) {
            Ok(loan) => loan,
            Err(error) => {
                self.shared.degrade(format!("tensors have no memory: {error}"));
                None
            }
        };
        match &mut self.loan {
            // What lies beyond the tensor in its last line is read by nobody, but must not carry what was there before.
            Some(loan) => {
                bytemuck::cast_slice_mut::<_, u8>(loan.payload_mut())
                    .get_mut(self.len_bytes..)
                    .unwrap_or_default()
                    .fill(0);
            }
            None => self.unlent += 1,
        }
    }

    fn memory(&mut self) -> Option<&mut [u8]> {
        let loan = self.loan.as_mut()?;
        bytemuck::cast_slice_mut(loan.payload_mut()).get_mut(..self.len_bytes)
    }

    fn end(&mut self, closed: Closed) {
        self.late += closed.late;
        let end = self.end_at.is_some_and(|t| closed.window.t1 > t);
        let Some(mut loan) = self.loan.take() else { return };
        *loan.user_header_mut() = self.header(closed.window, closed.events, end);
        self.send(loan);
        self.ended |= end;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_reaches_views_that_are_behind_also_when_all_stops() {
        let shared = Arc::new(Shared::new(1, "cam0".into(), Geometry::new(1, 1), false, 1));
        shared.stop();
        let pushing = shared.clone();
        let (producer, mut arrivals) = ring();
        let mut inlet = ViewInlet::new(producer, thread::current());
        let pipeline = thread::spawn(move || {
            for _ in 0..2 * SLOTS {
                inlet.push(&PacketHeader::default(), &[], &pushing);
            }
            inlet.push(&PacketHeader { flags: Flags::END.0, ..PacketHeader::default() }, &[], &pushing);
        });
        while shared.views_missed.load(Ordering::Relaxed) < SLOTS as u64 {
            thread::yield_now();
        }
        let mut ended = false;
        while !ended {
            let done = pipeline.is_finished();
            match arrivals.pop() {
                Some(packet) => ended = packet.header().flags.contains(Flags::END),
                None if done => break,
                None => thread::yield_now(),
            }
        }
        assert!(ended);
    }
}
