//! What the firmware does with a camera's bytes. The test on the host includes this very file.
//!
//! ```text
//!  packet ─▶ decoder ─▶ filter ─▶ slicer ─▶ view(s) ─▶ link
//! ```

use lobula_core::filter::{Denoise, DenoiseParams, DoubleWindow, DoubleWindowParams, PolarityMatch};
use lobula_core::link::{Message, serial};
use lobula_core::representation::{Count, Dtype, IntegerTimeSurface, Pixel, TileCount};
use lobula_core::ring::Rejected;
use lobula_core::wire::{AnyDecoder, evt2};
use lobula_core::{
    Block, Decode, Event, Filter, Geometry, Piece, Representation, Sink, Slicer, Span, Window, WrongGeometry,
};

/// The crop of the sensor that is worked on.
pub const GEOMETRY: Geometry = Geometry::new(320, 320);
/// Length of the views' windows.
pub const PERIOD_US: u32 = 2_000;
/// Bytes of the camera that come at a time.
pub const PACKET_BYTES: usize = 256;
/// Packets that the ring holds.
pub const SLOTS: usize = 4;
/// How many packets are lost where the main loop stops for a while.
pub const LOST: usize = 3;
/// Most bytes of a tensor in a message.
const PIECE_BYTES: usize = 256;
/// Memory for a frame with a piece in it.
pub const FRAME_BYTES: usize = PIECE_BYTES + 64;

/// The packet before which the main loop stops until [`LOST`] packets have found the ring full.
pub fn stall_at(bytes: &[u8]) -> usize {
    bytes.len() / PACKET_BYTES / 2
}

/// The denoising of the larger boards; hot pixels are [`HOT`].
pub const DENOISE: DenoiseParams = DenoiseParams {
    refractory_us: 200,
    support_us: 2_000,
    support: 2,
    polarity_match: PolarityMatch::Any,
    trail_us: 0,
    shift: 4,
};
/// Pixels taken for hot.
pub const HOT: [(u16, u16); 2] = [(160, 160), (7, 300)];
/// Entries of its memory.
pub const DENOISE_LEN: usize = Denoise::<u16, ()>::required_len(GEOMETRY);
/// Decay of the time surface.
pub const TAU_US: u32 = 3_000;
/// Words of the surface's state.
pub const SURFACE_LEN: usize = IntegerTimeSurface::<()>::state_len(GEOMETRY);
/// Bytes of a plane.
pub const PLANE_BYTES: usize = GEOMETRY.pixels();

/// The denoising of the small board.
pub const WINDOWS: DoubleWindowParams = DoubleWindowParams { window: 64, distance_px: 5, support: 1 };
/// Words of its memory.
pub const WINDOWS_LEN: usize = DoubleWindow::<()>::required_len(WINDOWS.window);
/// Width and height of its tiles: 20 x 20 of them.
pub const TILE_PX: u16 = 16;
/// Number of tiles.
pub const TILES: usize = 20 * 20;

/// What of the job does not grow with the sensor, and where its output goes.
pub struct Sender<'m, W> {
    encoder: serial::Encoder,
    frame: &'m mut [u8],
    write: W,
}

impl<'m, W: FnMut(&[u8])> Sender<'m, W> {
    /// Frames are made in `frame`, of [`FRAME_BYTES`], and handed to `write`.
    pub fn new(frame: &'m mut [u8], write: W) -> Self {
        Self { encoder: serial::Encoder::new(), frame, write }
    }

    fn send(&mut self, message: &Message<'_>) {
        // Every message fits: FRAME_BYTES is made for the longest.
        let len = self.encoder.encode(message, self.frame).unwrap_or_default();
        (self.write)(self.frame.get(..len).unwrap_or_default());
    }

    fn tensor(&mut self, view: u8, dtype: Dtype, (t0, t1): (u64, u64), bytes: &[u8]) {
        for (i, bytes) in bytes.chunks(PIECE_BYTES).enumerate() {
            let (dtype, offset) = (dtype as u8, (i * PIECE_BYTES) as u32);
            self.send(&Message::Tensor { view, dtype, t0, t1, offset, bytes });
        }
    }
}

/// The tensors of a job, and their memory.
pub trait Views {
    /// Draws a piece; at the end of a window sends what was drawn.
    fn draw<W: FnMut(&[u8])>(
        &mut self,
        piece: Piece<'_>,
        sender: &mut Sender<'_, W>,
    ) -> Result<(), WrongGeometry>;
}

fn draw<R: Representation>(
    view: &mut R,
    piece: Piece<'_>,
    out: &mut [R::Pixel],
) -> Result<(), WrongGeometry> {
    match piece {
        Piece::Begin(window) => view.begin(window, out),
        Piece::Events(span) => view.accumulate(span, out)?,
        Piece::End(_) => view.finish(out),
    }
    Ok(())
}

/// Count and time surface, with memory for each.
pub struct Planes<'m> {
    count: Count<u8>,
    counted: &'m mut [u8],
    surface: IntegerTimeSurface<&'m mut [u32]>,
    decayed: &'m mut [u8],
}

impl<'m> Planes<'m> {
    /// Memory of [`PLANE_BYTES`], [`SURFACE_LEN`] words, and twice [`PLANE_BYTES`].
    pub fn new(counted: &'m mut [u8], state: &'m mut [u32], decayed: &'m mut [u8]) -> Option<Self> {
        let surface = IntegerTimeSurface::try_new(GEOMETRY, TAU_US, state).ok()?;
        Some(Self { count: Count::new(GEOMETRY), counted, surface, decayed })
    }
}

/// To measure each alone.
#[allow(dead_code, reason = "the host does not measure")]
impl Planes<'_> {
    pub fn begin(&mut self, window: Window) {
        self.count.begin(window, self.counted);
        self.surface.begin(window, self.decayed);
    }

    pub fn count(&mut self, span: Span<'_>) -> usize {
        let _ = self.count.accumulate(span, self.counted);
        span.events.len()
    }

    pub fn stamp(&mut self, span: Span<'_>) -> usize {
        let _ = self.surface.accumulate(span, self.decayed);
        span.events.len()
    }
}

impl Views for Planes<'_> {
    fn draw<W: FnMut(&[u8])>(
        &mut self,
        piece: Piece<'_>,
        sender: &mut Sender<'_, W>,
    ) -> Result<(), WrongGeometry> {
        draw(&mut self.count, piece, self.counted)?;
        draw(&mut self.surface, piece, self.decayed)?;
        if let Piece::End(closed) = piece {
            let window = (closed.window.t0, closed.window.t1);
            sender.tensor(0, u8::DTYPE, window, self.counted);
            sender.tensor(1, u8::DTYPE, window, self.decayed);
        }
        Ok(())
    }
}

/// Counts of tiles, with memory for them.
pub struct Tiles<'m> {
    count: TileCount<u16>,
    counted: &'m mut [u16],
}

impl<'m> Tiles<'m> {
    /// Memory of [`TILES`].
    pub fn new(counted: &'m mut [u16]) -> Option<Self> {
        Some(Self { count: TileCount::try_new(GEOMETRY, TILE_PX).ok()?, counted })
    }
}

impl Views for Tiles<'_> {
    fn draw<W: FnMut(&[u8])>(
        &mut self,
        piece: Piece<'_>,
        sender: &mut Sender<'_, W>,
    ) -> Result<(), WrongGeometry> {
        draw(&mut self.count, piece, self.counted)?;
        if let Piece::End(closed) = piece {
            let window = (closed.window.t0, closed.window.t1);
            for (i, tiles) in self.counted.chunks(PIECE_BYTES / size_of::<u16>()).enumerate() {
                let mut bytes = [0; PIECE_BYTES];
                for (to, tile) in bytes.chunks_mut(size_of::<u16>()).zip(tiles) {
                    to.copy_from_slice(&tile.to_le_bytes());
                }
                let bytes = bytes.get(..size_of_val(tiles)).unwrap_or_default();
                let ((t0, t1), offset) = (window, (i * PIECE_BYTES) as u32);
                sender.send(&Message::Tensor { view: 0, dtype: u16::DTYPE as u8, t0, t1, offset, bytes });
            }
        }
        Ok(())
    }
}

/// A camera's bytes to frames of the link.
pub struct Job<'m, D, F, V, W> {
    decoder: D,
    filter: F,
    slicer: Slicer,
    views: V,
    sender: Sender<'m, W>,
    events: &'m mut [Event],
    expected: u32,
}

/// The job of the larger boards.
pub type Large<'m, W> = Job<'m, AnyDecoder, Denoise<u16, &'m mut [u16]>, Planes<'m>, W>;
/// The job of the small board.
pub type Small<'m, W> = Job<'m, evt2::Decoder, DoubleWindow<&'m mut [u32]>, Tiles<'m>, W>;

impl<'m, D: Decode, F: Filter, V: Views, W: FnMut(&[u8])> Job<'m, D, F, V, W> {
    /// `events` is room for those of a block.
    pub fn new(
        decoder: D,
        filter: F,
        views: V,
        mut sender: Sender<'m, W>,
        events: &'m mut [Event],
    ) -> Option<Self> {
        let (protocol, Geometry { width, height }) = (Message::PROTOCOL, GEOMETRY);
        sender.send(&Message::Hello { protocol, width, height, encoding: 0, name: "crop" });
        let slicer = Slicer::try_new(PERIOD_US).ok()?;
        Some(Self { decoder, filter, slicer, views, sender, events, expected: 0 })
    }

    /// Works on a packet; `rejected` is what the ring has turned away so far. False if anything went wrong.
    pub fn packet(&mut self, index: u32, bytes: &[u8], rejected: Rejected) -> bool {
        if index != self.expected {
            self.decoder.gap(Some(self.decoder.now()));
            self.losses(rejected);
        }
        self.expected = index.wrapping_add(1);
        let mut rest = bytes;
        while !rest.is_empty() {
            let mut sink = Sink::new(self.events);
            let taken = self.decoder.decode(rest, &mut sink);
            let mut block = sink.block(GEOMETRY);
            let (filter, views, sender) = (&mut self.filter, &mut self.views, &mut self.sender);
            if taken == 0 || !work(filter, &mut self.slicer, &mut block, views, sender) {
                return false;
            }
            rest = rest.get(taken..).unwrap_or_default();
        }
        true
    }

    /// The stream has ended.
    pub fn finish(&mut self, rejected: Rejected) {
        self.decoder.finish();
        let (views, sender) = (&mut self.views, &mut self.sender);
        self.slicer.finish(self.decoder.now(), |piece| {
            let _ = views.draw(piece, sender);
        });
        self.losses(rejected);
    }

    fn losses(&mut self, rejected: Rejected) {
        let counters = self.decoder.counters();
        let (faults, off_sensor) = (counters.faults.total() as u32, counters.off_sensor as u32);
        let (packets, bytes) = (rejected.packets as u32, rejected.elements as u32);
        self.sender.send(&Message::Losses { packets, bytes, faults, off_sensor });
    }
}

fn work<F: Filter, V: Views, W: FnMut(&[u8])>(
    filter: &mut F,
    slicer: &mut Slicer,
    block: &mut Block<'_>,
    views: &mut V,
    sender: &mut Sender<'_, W>,
) -> bool {
    let mut ok = filter.retain(block).is_ok();
    let span: Span<'_> = block.span();
    slicer.push(span, |piece| ok &= views.draw(piece, sender).is_ok());
    ok
}

/// The filter of the larger boards, in memory of [`DENOISE_LEN`] entries.
pub fn denoise<S: AsRef<[u16]> + AsMut<[u16]>>(memory: S) -> Option<Denoise<u16, S>> {
    let mut filter = Denoise::try_new(GEOMETRY, DENOISE, memory).ok()?;
    HOT.iter().all(|(x, y)| filter.mask(*x, *y)).then_some(filter)
}

/// A digest of bytes as they come: FNV-1a of 64 bits.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Digest(pub u64);

impl Digest {
    /// Of no bytes.
    pub const fn new() -> Self {
        Self(0xCBF2_9CE4_8422_2325)
    }

    /// Takes more bytes.
    pub fn extend(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01B3);
        }
    }
}
