//! The thread that paints: it owns the painter, does what it is told in order, and commits while there is something to commit.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering::{Acquire, Relaxed, Release};
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use fantex::base::Result;
use fantex::glam::DVec2;
use fantex::paint::{
    Decal, FillArea, FillSettings, GroupKind, Layer, LayerPlace, LiveStroke, Painter, Sample, SurfacePoint,
    move_layer,
};
use fantex::store::{ChannelKind, PageId, group_pages};
use fantex::stream::AtlasFormat;

use crate::paint::exchange::{page_texels, parcel_texels};
use crate::paint::messages::{Order, Report, Snapshot, StrokeStart};
use crate::paint::thumbnails::Thumbnails;
use crate::paint::{Alone, Exchange, Viewpoint};
use crate::viewer::Wake;
use saving::Saving;

mod saving;

/// Time slice per step of a long job.
const TIME_SLICE: Duration = Duration::from_millis(25);

/// Orders that arrive within this time are shown together.
const COALESCE_WINDOW: Duration = Duration::from_millis(6);

/// During strokes, coarser levels of earlier ones are made when no order has come for so long,
const LEVEL_GAP: Duration = Duration::from_millis(3);

/// and at least so often.
const LEVEL_INTERVAL: Duration = Duration::from_millis(60);

/// Pictures of layers are made when nothing was asked for so long.
const THUMBNAIL_DELAY: Duration = Duration::from_millis(150);

/// Requested pages that are answered per turn of the loop.
const MAX_PAGES_PER_TURN: usize = 32;

/// Steps of the history that are listed, the newest ones.
const MAX_LISTED_STEPS: usize = 1000;

/// A painter at work on a thread of its own. Dropping it commits, and waits for that.
#[derive(Debug)]
pub struct PaintThread {
    orders: Sender<Order>,
    reports: Receiver<Report>,
    exchange: Arc<Exchange>,
    sent: Arc<AtomicU64>,
    done: Arc<AtomicU64>,
    is_unsaved: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl PaintThread {
    /// Starts the thread.
    ///
    /// # Errors
    /// The operating system's, where there can be no further thread.
    pub fn start(mut painter: Painter, wake: Wake) -> std::io::Result<Self> {
        let (orders, received) = channel();
        let (told, reports) = channel();
        let exchange = Arc::new(Exchange::new(orders.clone(), painter.editor().asset().shared_cover()));
        let done = Arc::new(AtomicU64::new(0));
        let is_unsaved = Arc::new(AtomicBool::new(false));
        // What was changed when it was opened is not in the file as it is loaded.
        exchange.outdate(&painter.take_replaced());
        let worker = Worker {
            painter,
            orders: received,
            reports: told,
            exchange: exchange.clone(),
            done: done.clone(),
            is_unsaved: is_unsaved.clone(),
            wake,
            stroke: None,
            has_levels_due: false,
            levels_made: Instant::now(),
            waiting: VecDeque::new(),
            is_stuck: false,
            told_share: None,
            owed: 0,
            thumbnails: Thumbnails::default(),
            known_steps: 0,
            may_be_other: false,
            seen_alone: None,
            steps_of_drag: None,
            is_placing: false,
            previewed: BTreeSet::new(),
            outdated: BTreeSet::new(),
            saving: Saving::default(),
            is_astray: false,
        };
        let thread = std::thread::Builder::new().name("fantex-paint".into());
        let thread = Some(thread.spawn(move || worker.run())?);
        // Telling the first state counts as an order.
        let sent = Arc::new(AtomicU64::new(1));
        Ok(Self { orders, reports, exchange, sent, done, is_unsaved, thread })
    }

    pub fn exchange(&self) -> &Arc<Exchange> {
        &self.exchange
    }

    /// Gives an order. It is carried out after those before it.
    pub fn order(&self, order: Order) {
        self.sent.fetch_add(1, Relaxed);
        // A painter that is gone has said so.
        self.orders.send(order).ok();
    }

    /// What was told since the last call.
    pub fn reports(&self) -> Vec<Report> {
        self.reports.try_iter().collect()
    }

    /// Whether orders have not been carried out yet.
    pub fn is_busy(&self) -> bool {
        self.done() < self.sent()
    }

    /// Orders that were given since the start.
    pub(super) fn sent(&self) -> u64 {
        self.sent.load(Relaxed)
    }

    /// Those that have been carried out; what came of them is among the reports.
    pub(super) fn done(&self) -> u64 {
        self.done.load(Acquire)
    }

    /// Whether orders that have been carried out are not in the file yet, which may not have been reported. Asked after
    /// [`is_busy`](Self::is_busy) has denied, it counts all that was ordered.
    pub fn is_unsaved(&self) -> bool {
        self.is_unsaved.load(Acquire)
    }

    /// Whether it has ended before its time, by a fault of the program.
    pub fn is_gone(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }
}

impl Drop for PaintThread {
    fn drop(&mut self) {
        self.order(Order::Close);
        if let Some(thread) = self.thread.take() {
            // One that panicked has said so on standard error.
            thread.join().unwrap_or_default();
        }
    }
}

struct Worker {
    painter: Painter,
    orders: Receiver<Order>,
    reports: Sender<Report>,
    exchange: Arc<Exchange>,
    done: Arc<AtomicU64>,
    is_unsaved: Arc<AtomicBool>,
    wake: Wake,
    stroke: Option<LiveStroke>,
    /// Coarser levels of strokes are still to be made.
    has_levels_due: bool,
    /// When some were last made.
    levels_made: Instant,
    /// Orders that wait for what takes long.
    waiting: VecDeque<Order>,
    /// What takes long has failed, and so has giving it up: it is tried again when it is asked for.
    is_stuck: bool,
    /// How far what takes long was, when that was last told, in thousandths.
    told_share: Option<u32>,
    /// Orders that are done but for these.
    owed: u64,
    thumbnails: Thumbnails,
    /// Steps of the history when the state was last told, and whether what layers hold may be other since.
    known_steps: usize,
    may_be_other: bool,
    /// The layer whose mask is seen instead of the base colour.
    seen_alone: Option<Alone>,
    /// Steps of the history after a layer was dragged to where it is.
    steps_of_drag: Option<usize>,
    /// The open stroke is a text or a picture that may be taken away again.
    is_placing: bool,
    /// Coarser pages that show it.
    previewed: BTreeSet<PageId>,
    /// Coarser pages that show what was taken away.
    outdated: BTreeSet<PageId>,
    saving: Saving,
    /// What was painted last was written to a file that has no name any more.
    is_astray: bool,
}

impl Worker {
    fn run(mut self) {
        self.thumbnails.follow(self.painter.layers(), true);
        self.tell_state();
        if !self.is_working() {
            self.done.fetch_add(1, Release);
        } else {
            // Left by an earlier painter.
            self.owed = 1;
        }
        (self.wake)();
        while self.turn() {}
        // What was asked for is done; what takes long is left to whoever opens the asset next.
        // Nobody waits for what is handed over once that is finished.
        self.waiting.retain(|order| !matches!(order, Order::HandOver(_)));
        while !self.waiting.is_empty() {
            self.check(|worker| worker.painter.finish_work());
            self.is_stuck |= self.painter.has_work();
            self.act_on_waiting();
        }
        match self.is_placing {
            // It was not applied.
            true => self.check(|worker| worker.painter.abandon()),
            false => self.check(|worker| worker.painter.end().map(drop)),
        }
        if let Err(error) = self.painter.commit() {
            // The window is gone.
            eprintln!("fantex-app: {error}");
        }
    }

    /// Waits for orders and carries them out. False at the end.
    fn turn(&mut self) -> bool {
        let wait = match (self.has_levels_due, self.is_drawing()) {
            (true, true) => Some(Instant::now() + LEVEL_GAP),
            (true, false) => Some(Instant::now()),
            (false, _) => self.save_due(),
        };
        let wait =
            wait.map_or(Duration::from_secs(3600), |due| due.saturating_duration_since(Instant::now()));
        let is_idle = !self.is_working() && self.waiting.is_empty();
        let has_thumbnails = self.thumbnails.is_due() && !self.is_drawing() && !self.has_levels_due;
        let wait = match (is_idle, has_thumbnails) {
            (false, _) => Duration::ZERO,
            (true, true) => wait.min(THUMBNAIL_DELAY),
            (true, false) => wait,
        };
        let mut next = match self.orders.recv_timeout(wait) {
            Ok(order) => Some(order),
            Err(RecvTimeoutError::Timeout) => {
                if is_idle && has_thumbnails {
                    self.check(Self::make_thumbnail);
                }
                None
            }
            Err(RecvTimeoutError::Disconnected) => return false,
        };
        let begun = Instant::now();
        let mut count = 0;
        let mut goes_on = true;
        // Each sorts all groups that are left, and the window sends one per frame: only the newest counts.
        let mut looked_from = None;
        self.act_on_waiting();
        while let Some(order) = next.take() {
            // Requests for pages are not counted: the drawer makes them.
            count += u64::from(!matches!(order, Order::Pages | Order::Release(_)));
            if matches!(order, Order::Close) {
                goes_on = false;
                break;
            }
            // Orders keep their order.
            if let Order::Look(view) = order {
                looked_from = Some(view);
            } else if (self.is_working() || !self.waiting.is_empty()) && must_wait(&order) {
                self.waiting.push_back(order);
            } else {
                self.check(|worker| worker.act(order));
            }
            if begun.elapsed() < COALESCE_WINDOW {
                next = self.orders.try_recv().ok();
            }
        }
        if let Some(view) = looked_from.filter(|_| goes_on) {
            self.look_from(&view);
        }
        self.work_on();
        self.check(|worker| worker.make_levels(count == 0));
        self.check(Self::publish);
        self.answer_pages();
        self.note_changes();
        if self.save_due().is_some_and(|due| due <= Instant::now()) {
            self.save();
        }
        // Before the orders count as done.
        self.is_unsaved.store(self.saving.changed.is_some(), Release);
        self.owed += count;
        if !self.has_levels_due && !self.is_working() && self.waiting.is_empty() {
            self.done.fetch_add(std::mem::take(&mut self.owed), Release);
        }
        (self.wake)();
        goes_on
    }

    /// Makes some of the coarser levels that are due. Who draws comes first, unless there is nothing to do for it (`is_quiet`).
    fn make_levels(&mut self, is_quiet: bool) -> Result<()> {
        let is_later = self.is_drawing() && !is_quiet && self.levels_made.elapsed() < LEVEL_INTERVAL;
        if !self.has_levels_due || is_later {
            return Ok(());
        }
        let levels = self.painter.poll_levels();
        self.levels_made = Instant::now();
        self.has_levels_due = !matches!(levels, Ok(Some(_)));
        if !self.has_levels_due {
            self.tell_state();
        }
        levels.map(drop)
    }

    fn make_thumbnail(&mut self) -> Result<()> {
        if let Some((target, thumbnail)) = self.thumbnails.make(&mut self.painter)? {
            self.tell(Report::Thumbnail(target, thumbnail));
        }
        Ok(())
    }

    fn tell(&self, report: Report) {
        // The window may be closing: then nobody wants to know.
        self.reports.send(report).ok();
    }

    fn check(&mut self, act: impl FnOnce(&mut Self) -> Result<()>) {
        if let Err(error) = act(self) {
            self.tell(Report::Failed(error.to_string()));
        }
    }

    fn act(&mut self, order: Order) -> Result<()> {
        if self.is_placing && ends_placing(&order) {
            self.act(Order::Apply)?;
        }
        match order {
            Order::Begin(start, sample) => self.begin(*start, &sample)?,
            Order::GiveUp => self.painter.cancel_work()?,
            Order::Move(samples) => {
                for sample in &samples {
                    self.go_to(sample, false)?;
                }
            }
            Order::Lift => self.lift()?,
            Order::End(sample) => self.end(sample)?,
            Order::Fill(start, point, fill) => self.fill(*start, point, fill)?,
            Order::Place(start, decal, readable) => self.place(*start, &decal, readable)?,
            Order::Apply => {
                self.is_placing = false;
                self.previewed.clear();
                self.end_stroke()?;
            }
            Order::TakeAway => {
                self.is_placing = false;
                self.outdated.append(&mut self.previewed);
                self.painter.abandon()?;
            }
            Order::AddLayer(layer, place) => {
                let id = self.painter.start_add_layer(*layer, place)?;
                self.tell_added(id);
            }
            Order::EditLayers(label, change) => {
                self.painter.start_edit_layers(label, change)?;
                self.tell_state();
            }
            Order::DuplicateLayer(id) => {
                let copy = self.painter.start_duplicate_layer(id)?;
                self.tell_added(copy);
            }
            Order::MergeLayer(id) => {
                self.painter.start_merge_layer_down(id)?;
                self.may_be_other = true;
                self.tell_state();
            }
            Order::GroupLayer(id, name) => {
                let group = self.painter.start_group_layers(&name, GroupKind::default(), &[id])?;
                self.tell_added(group);
            }
            Order::MergeGroup(id) => {
                self.painter.start_merge_group(id)?;
                self.may_be_other = true;
                self.tell_state();
            }
            Order::Collapse(id, is_collapsed) => {
                self.painter.collapse_group(id, is_collapsed)?;
                self.tell_state();
            }
            Order::MoveLayer { id, place, goes_on } => self.move_layer(id, place, goes_on)?,
            Order::SeeAlone(what) => self.see_alone(what),
            Order::Undo => {
                self.stroke = None;
                self.painter.start_undo()?;
            }
            Order::Redo => {
                self.stroke = None;
                self.may_be_other = true;
                self.painter.start_redo()?;
            }
            Order::GoTo(count) => self.go_to_step(count)?,
            Order::Pick(point) => {
                let values = self.painter.pick_all(point)?;
                self.tell(Report::Picked(values));
            }
            Order::Probe(point) => {
                // A damaged page is no news to who only points at it.
                let values = self.painter.pick_all(point).unwrap_or_default();
                self.tell(Report::Probed(point, values));
            }
            Order::Commit => self.save(),
            Order::Leave => self.leave(),
            Order::HandOver(to) => {
                // Who asked may have given it up.
                to.send(self.hand_over()).ok();
            }
            Order::Copied => self.is_astray = false,
            Order::Release(loader) => drop(loader),
            // The loop's.
            Order::Pages | Order::Look(_) | Order::Close => {}
        }
        Ok(())
    }

    fn tell_added(&mut self, layer: u64) {
        self.tell(Report::Added(layer));
        self.tell_state();
    }

    /// Commits, and tells whether all is in the file.
    fn leave(&mut self) {
        // What is not applied is not saved; all else was, before it was shown.
        if !self.is_placing {
            self.save();
        }
        let is_saved = self.is_placing || !self.painter.editor().has_changes();
        if is_saved && self.saving.failed.is_none() {
            self.tell(Report::MayLeave);
        }
    }

    /// Moves a layer. A drag that goes on is one step of the history.
    fn move_layer(&mut self, id: u64, place: LayerPlace, goes_on: bool) -> Result<()> {
        if goes_on && self.steps_of_drag == Some(self.painter.history().done().len()) {
            self.painter.undo()?;
        }
        let (steps, before) = (self.painter.history().done().len(), self.painter.layers().to_vec());
        self.painter.start_edit_layers("move layer", |layers| move_layer(layers, id, place))?;
        // Back at its place it leaves no step.
        self.steps_of_drag = (before != self.painter.layers()).then_some(steps + 1);
        self.tell_state();
        Ok(())
    }

    fn see_alone(&mut self, what: Option<Alone>) {
        if std::mem::replace(&mut self.seen_alone, what) != what {
            self.exchange.outdate(&self.all_pages());
        }
    }

    fn all_pages(&self) -> Vec<PageId> {
        let cover = self.painter.editor().asset().shared_cover();
        (0u32..).zip(&cover.groups).flat_map(|(g, group)| group_pages(g, group)).collect()
    }

    /// The bytes of a page in a channel that looks different for the moment. `shown`: those of channels that are not shown as they are
    /// kept.
    fn alone(&mut self, page: PageId, shown: &BTreeMap<usize, Vec<u8>>) -> Result<Option<(usize, Vec<u8>)>> {
        match self.seen_alone {
            Some(Alone::Mask(id)) => {
                let has_mask = |layer: &Layer| layer.id() == id && layer.mask.is_some();
                if !self.painter.layers().iter().any(has_mask) {
                    return Ok(None);
                }
                self.painter.mask_as_color(id, page).map(Some)
            }
            Some(Alone::Height) => {
                let channel = self.painter.editor().asset().channel_of_kind(ChannelKind::Displacement);
                let height = channel.and_then(|channel| shown.get(&channel));
                self.painter.height_as_color(page, height.map(Vec::as_slice))
            }
            None => Ok(None),
        }
    }

    /// Shows something on the surface that is not applied yet, instead of what was shown so before.
    fn place(&mut self, start: StrokeStart, decal: &Decal, readable: bool) -> Result<()> {
        if !std::mem::replace(&mut self.is_placing, true) {
            // What is shown only is not saved: all else is before.
            self.painter.end()?;
            self.save();
        }
        self.outdated.append(&mut self.previewed);
        self.painter.abandon()?;
        let decals = decal.copies(self.painter.surface(), &start.symmetry, readable);
        self.open(start)?;
        decals.iter().try_for_each(|decal| self.painter.decal(decal))
    }

    fn begin(&mut self, start: StrokeStart, sample: &Sample) -> Result<()> {
        let (brush, stamp, symmetry) = (start.brush.clone(), start.stamp.clone(), start.symmetry);
        self.open(start)?;
        self.stroke = Some(LiveStroke::new(self.painter.surface(), brush, stamp, symmetry));
        self.go_to(sample, false)
    }

    /// Ends the stroke, at a sample where one is still to be reached.
    fn end(&mut self, sample: Option<Sample>) -> Result<()> {
        match sample {
            Some(sample) => self.go_to(&sample, true)?,
            None => self.lift()?,
        }
        self.stroke = None;
        self.end_stroke()
    }

    fn fill(&mut self, start: StrokeStart, point: Option<SurfacePoint>, fill: FillSettings) -> Result<()> {
        let area = FillArea::of(self.painter.surface(), fill, &start.paint, point, &start.symmetry);
        self.open(start)?;
        area.map_or(Ok(()), |area| self.painter.start_fill(area))
    }

    /// Opens a stroke for the painter.
    fn open(&mut self, start: StrokeStart) -> Result<()> {
        self.stroke = None;
        self.thumbnails.changed(start.target);
        self.painter.begin_on(start.target, &start.label, start.paint)?;
        // For the log. Where it cannot be told, it is painted all the same.
        self.check(|worker| worker.painter.record_loaded(start.recorded, Path::new(""), &start.files));
        Ok(())
    }

    fn go_to(&mut self, sample: &Sample, is_end: bool) -> Result<()> {
        let Some(stroke) = &mut self.stroke else { return Ok(()) };
        let dabs = stroke.go_to(self.painter.surface(), sample, is_end);
        self.painter.dab(&dabs)
    }

    /// What comes after is not joined to what came before.
    fn lift(&mut self) -> Result<()> {
        let Some(stroke) = &mut self.stroke else { return Ok(()) };
        let dabs = stroke.lift(self.painter.surface());
        self.painter.dab(&dabs)
    }

    /// Ends the open stroke; its coarser levels come later.
    fn end_stroke(&mut self) -> Result<()> {
        self.painter.end_in_background()?;
        self.has_levels_due = true;
        Ok(())
    }

    /// Brings what has changed to the atlas.
    fn publish(&mut self) -> Result<()> {
        let shown = self.painter.show()?;
        let replaced = self.painter.take_replaced();
        let formats = match self.exchange.formats() {
            Some(formats) if !self.is_working() => formats,
            // Nothing shows it yet, or most of it is not seen: what is wanted is asked for.
            _ => {
                self.exchange.outdate(&replaced);
                return Ok(());
            }
        };
        let published = self.publish_in(&formats, &shown, &replaced);
        if self.exchange.formats().as_ref() != Some(&formats) {
            // Another device has taken over meanwhile.
            self.exchange.forget_texels();
        }
        published
    }

    fn publish_in(&mut self, formats: &[AtlasFormat], shown: &[PageId], replaced: &[PageId]) -> Result<()> {
        let exchange = Arc::clone(&self.exchange);
        exchange.publish(replaced, |page| {
            let alone = self.alone(page, &BTreeMap::new())?.into_iter().collect();
            page_texels(&self.painter, page, formats, &alone)
        })?;
        if shown.is_empty() || (self.stroke.is_none() && !self.is_placing) {
            return self.publish_outdated(formats, &BTreeSet::new());
        }
        let mut coarser: BTreeMap<PageId, BTreeMap<usize, Vec<u8>>> = BTreeMap::new();
        for page in self.painter.preview(shown)? {
            coarser.entry(page.id).or_default().insert(page.channel, page.bytes);
        }
        let previewed: BTreeSet<PageId> = coarser.keys().copied().collect();
        self.publish_outdated(formats, &previewed)?;
        if self.is_placing {
            self.previewed = previewed;
        }
        for (page, mut bytes) in coarser {
            bytes.extend(self.alone(page, &bytes)?);
            exchange.publish_preview(page, page_texels(&self.painter, page, formats, &bytes)?);
        }
        Ok(())
    }

    /// Coarser pages that showed what was taken away are as they were, but for some.
    fn publish_outdated(&mut self, formats: &[AtlasFormat], but: &BTreeSet<PageId>) -> Result<()> {
        for page in std::mem::take(&mut self.outdated).into_iter().filter(|page| !but.contains(page)) {
            let bytes = self.alone(page, &BTreeMap::new())?.into_iter().collect();
            self.exchange.publish_preview(page, page_texels(&self.painter, page, formats, &bytes)?);
        }
        Ok(())
    }

    fn answer_pages(&mut self) {
        let Some(formats) = self.exchange.formats() else { return };
        let wanted = self.exchange.wanted(MAX_PAGES_PER_TURN);
        for &parcel in &wanted {
            let cover = self.painter.editor().asset().shared_cover();
            let none = BTreeMap::new();
            let shown = match self.seen_alone {
                None => Ok(BTreeMap::new()),
                Some(_) => parcel
                    .pages(&cover)
                    .filter_map(|page| Some(self.alone(page, &none).transpose()?.map(|alone| (page, alone))))
                    .collect(),
            };
            let texels = shown.and_then(|shown| parcel_texels(&self.painter, parcel, &formats, &shown));
            if self.exchange.formats().as_ref() != Some(&formats) {
                // They are for another device: it is asked once more.
                return self.exchange.ask_again();
            }
            self.exchange.answer(parcel, texels);
        }
        if wanted.len() == MAX_PAGES_PER_TURN {
            self.exchange.ask_again();
        }
    }

    fn tell_state(&mut self) {
        // What is taken back may be anything.
        let steps = self.painter.history().done().len();
        let changed = std::mem::replace(&mut self.known_steps, steps) > steps || self.may_be_other;
        self.may_be_other = false;
        self.thumbnails.follow(self.painter.layers(), changed);
        let history = self.painter.history();
        let older = history.done().len().saturating_sub(MAX_LISTED_STEPS);
        let names =
            |steps: &[fantex::paint::HistoryStep]| steps.iter().map(|step| step.label.clone()).collect();
        self.tell(Report::State(Box::new(Snapshot {
            layers: self.painter.layers().to_vec(),
            collapsed: self.painter.collapsed_groups().clone(),
            older,
            done: names(&history.done()[older..]),
            undone: names(history.undone()),
        })));
    }
}

// Long jobs: time-sliced, cancellable, visible tiles first.

impl Worker {
    /// Orders that had to wait, as long as nothing goes on that takes long.
    fn act_on_waiting(&mut self) {
        while !self.is_working()
            && let Some(order) = self.waiting.pop_front()
        {
            self.check(|worker| worker.act(order));
        }
    }

    /// Whether commits are to be few.
    pub(crate) fn is_drawing(&self) -> bool {
        self.stroke.is_some() || self.is_working()
    }

    /// Whether something goes on that takes long.
    pub(crate) fn is_working(&self) -> bool {
        self.painter.has_work() && !self.is_stuck
    }

    /// Goes on with what takes long, and tells how far it is.
    fn work_on(&mut self) {
        if self.is_working() {
            // Before the first slice, too.
            self.tell_progress();
            match self.painter.work_on(Instant::now() + TIME_SLICE) {
                Ok(true) => self.tell_state(),
                Ok(false) => {}
                Err(error) => {
                    self.tell(Report::Failed(error.to_string()));
                    self.give_up();
                }
            }
        }
        self.tell_progress();
    }

    fn tell_progress(&mut self) {
        let progress = self.painter.work_progress().filter(|_| !self.is_stuck);
        let share = progress.as_ref().map(|progress| (progress.share * 1000.0) as u32);
        if share != self.told_share {
            self.told_share = share;
            self.tell(Report::Work(progress));
            (self.wake)();
        }
    }

    /// Takes back what takes long, after it has failed.
    fn give_up(&mut self) {
        let before = self.painter.work_progress().map(|progress| progress.is_undo);
        let given_up = self.painter.cancel_work();
        let after = self.painter.work_progress().map(|progress| progress.is_undo);
        self.is_stuck = given_up.is_err() || (before == after && before.is_some());
    }

    /// Lets what is seen from somewhere come first, the nearest first.
    pub(crate) fn look_from(&mut self, view: &Viewpoint) {
        let surface = self.painter.surface().clone();
        let place = surface.mesh().world_from_mesh;
        self.painter.prefer_groups(|group| {
            let Some(triangle) = surface.triangle_of_group(group) else { return f32::NEG_INFINITY };
            let [a, b, c] = surface.mesh().triangle_positions(triangle as usize);
            let point = place.point((a + b + c) / 3.0);
            let is_seen = view
                .project(point)
                .is_some_and(|at| at.cmpge(DVec2::splat(-0.05)).all() && at.cmple(DVec2::splat(1.05)).all());
            let facing = surface.outer_normal(triangle).dot(view.rig.eye - point) > 0.0;
            let nearness = -((point - view.rig.eye).length() / place.scale) as f32;
            // Mesh units are about the model's size: what is seen is nearer than anything else.
            nearness - if is_seen { 0.0 } else { 1e4 } - if facing { 0.0 } else { 1e3 }
        });
    }

    pub(crate) fn go_to_step(&mut self, count: usize) -> Result<()> {
        self.stroke = None;
        self.painter.end()?;
        let done = self.painter.history().done().len();
        let is_started = match done.cmp(&count) {
            Ordering::Greater => self.painter.start_undo()?,
            Ordering::Less => {
                self.may_be_other = true;
                self.painter.start_redo()?
            }
            Ordering::Equal => false,
        };
        if is_started {
            // And on from there.
            self.waiting.push_front(Order::GoTo(count));
        }
        self.tell_state();
        Ok(())
    }
}

/// Whether an order applies what is shown and not applied yet.
fn ends_placing(order: &Order) -> bool {
    !matches!(
        order,
        Order::Place(..)
            | Order::Apply
            | Order::TakeAway
            | Order::Pages
            | Order::Release(_)
            | Order::Look(_)
            | Order::Pick(_)
            | Order::Probe(_)
            | Order::SeeAlone(_)
            | Order::Collapse(..)
            | Order::Leave
            | Order::Copied
            | Order::Close
    )
}

/// Whether an order waits until what takes long is done.
fn must_wait(order: &Order) -> bool {
    !matches!(
        order,
        Order::Pages
            | Order::Release(_)
            | Order::Look(_)
            | Order::GiveUp
            | Order::Commit
            | Order::Leave
            | Order::Copied
            | Order::Pick(_)
            | Order::Probe(_)
            | Order::SeeAlone(_)
            | Order::Close
    )
}
