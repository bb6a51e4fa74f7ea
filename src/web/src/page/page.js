// The page of a city: it draws what the server tells, and asks for what the person wants. Nothing comes from elsewhere.
'use strict';
const $ = (id) => document.getElementById(id);
const LARGE = 0, SMALL = 1;
const token = location.hash.slice(1);
let socket = null, mayOrder = false, hasPictures = false, offered = token, wait = 250;
let isLog = false, told = null;
// As a guest: the page's number, whether it has joined, its car, and what it was told of the car.
let guest = null, isJoined = false, own = null, toldTrouble = null;
let map = null, state = null, roster = new Map(), selected = null, sortBy = 'id', sortDown = false, refusals = null;
const camera = { x: 0, y: 0, scale: 1, isSet: false, isMoved: false };
const orbit = { azimuth: 220, elevation: 35, distance: 120 };
const keys = new Set();
let driven = null, steering = 0;

function send(message) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function notice(text) {
  $('notice').textContent = text || '';
  $('notice').hidden = !text;
}

function connect() {
  socket = new WebSocket(`ws://${location.host}/socket`);
  socket.binaryType = 'arraybuffer';
  socket.onopen = () => send({ t: 'hello', token: offered || null });
  socket.onmessage = (event) => typeof event.data === 'string' ? hear(JSON.parse(event.data)) : show(event.data);
  socket.onclose = (event) => {
    if (event.code === 4401) {
      offered = '';
      notice('The token of this address is not that of the city: this page watches. Open the address that the city prints.');
    }
    stopDriving();
    [isJoined, own] = [false, null];
    $('status').textContent = 'no connection; trying again';
    setTimeout(connect, wait);
    wait = Math.min(2 * wait, 4000);
  };
}

function hear(message) {
  if (message.t === 'welcome') {
    wait = 250;
    [mayOrder, hasPictures, isLog, guest] = [message.may_order, message.has_pictures, message.is_log, message.guest];
    for (const id of ['start', 'pause', 'reset', 'speed', 'seek']) $(id).disabled = !mayOrder;
    $('start').textContent = isLog ? 'Play' : 'Start';
    $('timeline').hidden = !isLog;
    $('reset').hidden = $('drive').hidden = isLog;
    $('drive').disabled = !mayOrder || selected === null;
    $('mode').disabled = !hasPictures;
    if (message.no_pictures) notice(`No pictures: ${message.no_pictures}`);
    refusals = null;
    canDecode.then((can) => { hasVideo = can && message.has_h264 && !hasVideoFailed; look(); });
  } else if (message.t === 'map') {
    map = message;
    $('scenario').textContent = map.scenario;
    if (!camera.isSet) showAll();
  } else if (message.t === 'roster') {
    roster = new Map(message.vehicles.map(([id, name, length, width]) => [id, { name, length, width }]));
    tabulate();
  } else if (message.t === 'events') {
    told = message;
    listEvents();
    markEvents();
  } else if (message.t === 'state') {
    state = message;
    requestAnimationFrame(draw);
    tell();
    followGuest();
  } else if (message.t === 'notice') {
    notice(message.text);
  } else if (message.t === 'pong') {
    window.roundTrip = performance.now() - message.sent_ms;
  }
}

// Pictures

const PLACES = ['large', 'small'];

// Before a picture come its place (bit 0) and its kind: JPEG, or a key frame or another frame of H.264.
async function show(buffer) {
  const head = new Uint8Array(buffer)[0], slot = head & 1, kind = head >> 1;
  const bytes = new Uint8Array(buffer, 1);
  if (kind > 0) return decode(slot, kind === 1 ? 'key' : 'delta', bytes);
  try {
    paint(slot, await createImageBitmap(new Blob([bytes], { type: 'image/jpeg' })), 'jpeg');
  } catch {
    // The server sends the next one once this one is said to be seen.
    send({ t: 'seen', slot });
  }
}

function paint(slot, picture, codec) {
  const canvas = $(PLACES[slot]);
  const [width, height] = [picture.displayWidth ?? picture.width, picture.displayHeight ?? picture.height];
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  canvas.getContext('2d', { alpha: false }).drawImage(picture, 0, 0);
  picture.close();
  canvas.dataset.pictures = Number(canvas.dataset.pictures || 0) + 1;
  canvas.dataset.codec = codec;
  canvas.dispatchEvent(new Event('picture'));
  window.firstPicture ??= performance.now();
  send({ t: 'seen', slot });
}

// H.264 where the browser decodes it (WebCodecs, which pages have from this machine or by a tunnel alone) and the server
// makes it. Whatever goes wrong with it, the page goes on with JPEG.
const DECODER = { codec: 'avc1.42E028', optimizeForLatency: true };
const DECODER_PATIENCE_MS = 3000;
const decoders = [null, null], overdue = [0, 0];
let hasVideo = false, hasVideoFailed = false, frames = 0;
const canDecode = (async () => {
  try { return (await VideoDecoder.isConfigSupported(DECODER)).supported; } catch { return false; }
})();

function decode(slot, type, data) {
  if (!hasVideo) return;
  try {
    decoders[slot] ??= openDecoder(slot);
    clearTimeout(overdue[slot]);
    overdue[slot] = setTimeout(endVideo, DECODER_PATIENCE_MS);
    decoders[slot].decode(new EncodedVideoChunk({ type, timestamp: (frames += 1) * 33333, data }));
  } catch { endVideo(); }
}

function openDecoder(slot) {
  const output = (frame) => { clearTimeout(overdue[slot]); paint(slot, frame, 'h264'); };
  const decoder = new VideoDecoder({ output, error: endVideo });
  decoder.configure(DECODER);
  return decoder;
}

function endVideo() {
  if (!hasVideo) return;
  [hasVideo, hasVideoFailed] = [false, true];
  overdue.forEach((timer) => clearTimeout(timer));
  for (const decoder of decoders) if (decoder && decoder.state !== 'closed') decoder.close();
  decoders.fill(null);
  look();
}

function size(image, aspect) {
  const width = Math.round(Math.min(image.clientWidth || 480, 960));
  return { width, height: Math.round(width / aspect) };
}

function largeView() {
  const [x_m, y_m] = [Math.round(camera.x), Math.round(camera.y)];
  switch ($('mode').value) {
    case 'chase': return selected === null ? null : { mode: 'chase', vehicle: selected };
    case 'orbit': return { mode: 'orbit', x_m, y_m, distance_m: Math.round(orbit.distance),
      azimuth_deg: Math.round(orbit.azimuth), elevation_deg: Math.round(orbit.elevation) };
    case 'overhead': return { mode: 'overhead', x_m, y_m, height_m: Math.round(orbit.distance) };
    default: return null;
  }
}

const asked = ['', ''];
function look(slot) {
  if (slot === undefined) { asked.fill(''); look(LARGE); look(SMALL); return; }
  if (!hasPictures) return;
  const view = slot === LARGE ? largeView() : selected === null ? null : { mode: 'onboard', vehicle: selected };
  const message = { t: 'look', slot, view, h264: hasVideo, ...(slot === LARGE ? size($('large'), 16 / 9) : size($('small'), 4 / 3)) };
  const text = JSON.stringify(message);
  if (text !== asked[slot]) { asked[slot] = text; send(message); }
}

let isLookDue = false;
function lookSoon() {
  if (isLookDue) return;
  isLookDue = true;
  setTimeout(() => { isLookDue = false; look(LARGE); }, 80);
}

$('mode').onchange = () => look(LARGE);
drag($('large'), (dx, dy) => {
  orbit.azimuth = (orbit.azimuth - dx * 0.4 + 720) % 360;
  orbit.elevation = Math.min(89, Math.max(5, orbit.elevation + dy * 0.3));
  lookSoon();
}, (factor) => { orbit.distance = Math.min(1000, Math.max(10, orbit.distance * factor)); lookSoon(); });

// Plan

function showAll() {
  const canvas = $('plan'), [x0, y0, x1, y1] = map.bounds;
  camera.x = (x0 + x1) / 2;
  camera.y = (y0 + y1) / 2;
  camera.scale = Math.min(canvas.clientWidth / (x1 - x0), canvas.clientHeight / (y1 - y0)) * 0.95;
  camera.isSet = true;
  requestAnimationFrame(draw);
}

let roads = null;
function draw() {
  if (!map) return;
  const canvas = $('plan'), ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
  if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
  if (!roads || roads.of !== map) roads = { of: map, lanes: map.lanes.map(path) };
  const pen = canvas.getContext('2d');
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.fillStyle = '#12161b';
  pen.fillRect(0, 0, canvas.width, canvas.height);
  const scale = camera.scale * ratio;
  pen.setTransform(scale, 0, 0, -scale, canvas.width / 2 - camera.x * scale, canvas.height / 2 + camera.y * scale);
  pen.strokeStyle = '#39424e';
  for (const lane of roads.lanes) { pen.lineWidth = lane.width; pen.stroke(lane.path); }
  for (const [id, x, y, yaw, , status] of state?.vehicles ?? []) {
    const { length = 4.5, width: breadth = 1.8, name = id } = roster.get(id) ?? {};
    const grow = Math.max(1, 9 / (length * camera.scale));
    pen.save();
    pen.translate(x, y);
    pen.rotate(yaw);
    pen.scale(grow, grow);
    pen.fillStyle = id === selected ? '#6cb6ff' : status === 'collided' ? '#ff6b5e' : '#f0c65a';
    pen.beginPath();
    pen.moveTo(length / 2, 0);
    pen.lineTo(length / 4, breadth / 2);
    pen.lineTo(-length / 2, breadth / 2);
    pen.lineTo(-length / 2, -breadth / 2);
    pen.lineTo(length / 4, -breadth / 2);
    pen.fill();
    pen.restore();
    if (id === selected) {
      pen.save();
      pen.translate(x, y);
      pen.scale(1 / camera.scale, -1 / camera.scale);
      pen.fillStyle = '#dde3ea';
      pen.font = '13px system-ui, sans-serif';
      pen.fillText(name, 10, -8);
      pen.restore();
    }
  }
}

function path({ w, p }) {
  const line = new Path2D();
  for (let k = 0; k < p.length; k += 2) line[k ? 'lineTo' : 'moveTo'](p[k], p[k + 1]);
  return { width: w, path: line };
}

function move(dx, dy) {
  camera.isMoved = true;
  camera.x -= dx / camera.scale;
  camera.y += dy / camera.scale;
  requestAnimationFrame(draw);
  lookSoon();
}

function zoom(factor) {
  camera.isMoved = true;
  camera.scale = Math.min(60, Math.max(0.05, camera.scale / factor));
  requestAnimationFrame(draw);
}

// Dragging with one pointer moves, a wheel or two pointers zoom.
function drag(element, onMove, onZoom) {
  const pointers = new Map();
  element.addEventListener('pointerdown', (event) => {
    pointers.set(event.pointerId, event);
    element.setPointerCapture(event.pointerId);
    event.preventDefault();
    element.focus();
  });
  element.addEventListener('pointermove', (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    if (pointers.size === 2) {
      const other = [...pointers.values()].find((p) => p.pointerId !== event.pointerId);
      const span = (p) => Math.hypot(p.clientX - other.clientX, p.clientY - other.clientY);
      onZoom(span(before) / Math.max(1, span(event)));
    } else {
      onMove(event.clientX - before.clientX, event.clientY - before.clientY);
    }
    pointers.set(event.pointerId, event);
  });
  for (const end of ['pointerup', 'pointercancel']) element.addEventListener(end, (event) => pointers.delete(event.pointerId));
  element.addEventListener('wheel', (event) => { event.preventDefault(); onZoom(event.deltaY > 0 ? 1.15 : 1 / 1.15); },
    { passive: false });
}

drag($('plan'), move, zoom);
$('plan').addEventListener('click', (event) => {
  const box = $('plan').getBoundingClientRect();
  const x = camera.x + (event.clientX - box.left - box.width / 2) / camera.scale;
  const y = camera.y - (event.clientY - box.top - box.height / 2) / camera.scale;
  const near = (state?.vehicles ?? []).map((v) => [Math.hypot(v[1] - x, v[2] - y), v[0]]).sort((a, b) => a[0] - b[0])[0];
  if (near && near[0] * camera.scale < 20) select(near[1]);
});
$('plan').addEventListener('keydown', (event) => {
  if (driven !== null) return;
  const steps = { ArrowLeft: [40, 0], ArrowRight: [-40, 0], ArrowUp: [0, 40], ArrowDown: [0, -40] };
  if (steps[event.key]) move(...steps[event.key]);
  else if (event.key === '+') zoom(0.8);
  else if (event.key === '-') zoom(1.25);
  else if (event.key === '0' && map) showAll();
  else return;
  event.preventDefault();
});
addEventListener('resize', () => {
  if (map && !camera.isMoved) showAll();
  requestAnimationFrame(draw);
  look();
});

function clear(canvas) {
  canvas.getContext('2d', { alpha: false }).clearRect(0, 0, canvas.width, canvas.height);
}

// Table, numbers and events

function select(id) {
  if (driven !== null && driven !== id) stopDriving();
  selected = id;
  $('selected').textContent = roster.get(id)?.name ?? `vehicle ${id}`;
  $('drive').disabled = !mayOrder;
  clear($('small'));
  look(SMALL);
  look(LARGE);
  tabulate();
  requestAnimationFrame(draw);
}

for (const button of document.querySelectorAll('th button')) {
  button.onclick = () => {
    sortDown = sortBy === button.dataset.by && !sortDown;
    sortBy = button.dataset.by;
    tabulate();
  };
}

function tabulate() {
  if (!state) return;
  const value = { id: (v) => v[0], name: (v) => roster.get(v[0])?.name ?? '', status: (v) => v[5], speed: (v) => v[4] }[sortBy];
  const order = (a, b) => (value(a) < value(b) ? -1 : value(a) > value(b) ? 1 : a[0] - b[0]) * (sortDown ? -1 : 1);
  const rows = $('rows'), vehicles = [...state.vehicles].sort(order);
  while (rows.rows.length > vehicles.length) rows.deleteRow(-1);
  while (rows.rows.length < vehicles.length) {
    const row = rows.insertRow();
    for (let k = 0; k < 5; k += 1) row.insertCell();
    row.tabIndex = 0;
    row.onclick = () => select(Number(row.dataset.id));
    row.onkeydown = (event) => { if (event.key === 'Enter' || event.key === ' ') { event.preventDefault(); row.onclick(); } };
  }
  vehicles.forEach((v, k) => {
    const row = rows.rows[k];
    row.dataset.id = v[0];
    row.setAttribute('aria-selected', v[0] === selected);
    const texts = [v[0], roster.get(v[0])?.name ?? '', v[5], `${v[1].toFixed(1)}, ${v[2].toFixed(1)}`, `${v[4].toFixed(1)} m/s`];
    texts.forEach((text, c) => { if (row.cells[c].textContent !== String(text)) row.cells[c].textContent = text; });
  });
}

let tabulatedAt = 0;
function tell() {
  const leader = state.leader ? `, led by ${state.leader}` : '';
  $('status').textContent = `${state.ended ? 'ended' : state.phase} at ${state.time.toFixed(1)} s, ${state.vehicles.length} vehicles${leader}${mayOrder ? '' : ' (watching)'}`;
  showTime();
  showSpeed();
  if (refusals !== null && state.refusal && state.refusal[0] !== refusals) notice(state.refusal[1]);
  refusals = state.refusal ? state.refusal[0] : 0;
  const own = state.vehicles.find((v) => v[0] === selected);
  if (own) {
    const degrees = own[6] * 180 / Math.PI;
    $('steering').value = -degrees;
    $('steering_text').textContent = `${Math.abs(degrees).toFixed(0)}° ${degrees < 0 ? 'right' : 'left'}`;
    [$('gas').value, $('brake').value, $('handbrake').value] = own.slice(7, 10);
  }
  if (performance.now() - tabulatedAt < 200) return;
  tabulatedAt = performance.now();
  tabulate();
  const mean = state.vehicles.reduce((sum, v) => sum + v[4], 0) / Math.max(1, state.vehicles.length);
  const facts = [['mean speed', `${mean.toFixed(2)} m/s`],
    ...(isLog ? [['speed of the playback', `${state.speed} times`]] : [['real-time factor', state.rate], ['run', state.run]]),
    ['pages', state.pages],
    ...state.ends.map(([name, delivered, dropped, failure]) => [name, failure ?? `${delivered} sent, ${dropped} dropped`])];
  $('metrics').replaceChildren(...facts.flatMap(([name, text]) => {
    const [term, detail] = [document.createElement('dt'), document.createElement('dd')];
    [term.textContent, detail.textContent] = [name, text];
    return [term, detail];
  }));
}

// Of a log all events are known; those up to the shown time are listed.
let listed = '';
function listEvents() {
  const events = isLog ? told.events.filter(([time]) => time <= (state?.time ?? 0) + 0.005) : told.events;
  const present = `${told.count} ${events.length}`;
  if (isLog && listed === present) return;
  listed = present;
  $('events').replaceChildren(...events.slice(-60).reverse().map(([time, id, what]) => {
    const item = document.createElement('li');
    item.textContent = `${time.toFixed(1)} s ${roster.get(id)?.name ?? id}: ${what}`;
    return item;
  }));
}

// Timeline of a log

function markEvents() {
  if (!isLog) return;
  $('marks').replaceChildren(...told.events.slice(0, 300).map(([time]) => {
    const option = document.createElement('option');
    option.value = time;
    return option;
  }));
}

// A served city keeps its speed.
function showSpeed() {
  $('speed').disabled = !mayOrder || state.keeps_speed;
  const known = [...$('speed').options].some((option) => Number(option.value) === state.speed);
  if (known && document.activeElement !== $('speed')) $('speed').value = String(state.speed);
}

let isSeeking = false, soughtAt = 0;
function showTime() {
  if (!state.log) return;
  const [from, to, at] = state.log;
  [$('seek').min, $('seek').max] = [from, to];
  if (!isSeeking) $('seek').value = at;
  $('at').textContent = `${(isSeeking ? Number($('seek').value) : at).toFixed(1)} of ${to.toFixed(1)} s`;
  if (told) listEvents();
}

$('seek').oninput = () => {
  isSeeking = true;
  if (performance.now() - soughtAt > 80) sought();
};
$('seek').onchange = () => { isSeeking = false; sought(); };
function sought() {
  soughtAt = performance.now();
  notice('');
  send({ t: 'seek', time_s: Number($('seek').value) });
}

// Experiment and driving

for (const id of ['start', 'pause', 'reset']) $(id).onclick = () => { notice(''); send({ t: id }); };
$('speed').onchange = () => { notice(''); send({ t: 'speed', factor: Number($('speed').value) }); };

const PEDAL_KEYS = { KeyW: 'gas', ArrowUp: 'gas', KeyS: 'brake', ArrowDown: 'brake', KeyA: 'left', ArrowLeft: 'left',
  KeyD: 'right', ArrowRight: 'right', Space: 'handbrake', KeyR: 'reverse' };
const MAX_STEERING_RAD = 0.5, STEERING_RADPS = 1.2;

$('drive').onclick = () => driven === null ? drive() : stopDriving();

function drive() {
  driven = selected;
  steering = 0;
  $('drive').setAttribute('aria-pressed', 'true');
  $('pad').hidden = false;
  notice(matchMedia('(pointer: coarse)').matches ? '' : 'W gas, S brake, A and D steer, Space handbrake, R held reverse, Esc ends');
  $('drive').blur();
}

function stopDriving() {
  if (driven === null) return;
  send({ t: 'release' });
  driven = null;
  keys.clear();
  touched.clear();
  wheel = null;
  turn(0);
  $('pad').hidden = true;
  $('reverse').setAttribute('aria-pressed', 'false');
  $('drive').setAttribute('aria-pressed', 'false');
}

// A guest's car: it comes when the city has room, is driven at once, and goes with its page.
$('join').onclick = () => {
  notice('');
  isJoined = !isJoined;
  toldTrouble = null;
  if (!isJoined && driven === own) stopDriving();
  send({ t: isJoined ? 'join' : 'leave' });
  $('join').blur();
  followGuest();
};

function followGuest() {
  $('join').hidden = isLog || !mayOrder || !state?.guests;
  $('join').textContent = isJoined ? 'Leave with my car' : 'Join with a car of my own';
  const [, car, trouble] = isJoined ? state?.guests?.find(([number]) => number === guest) ?? [] : [];
  if (trouble && trouble !== toldTrouble) notice(`${trouble}.`);
  toldTrouble = trouble ?? null;
  const isThere = state?.vehicles.some(([id]) => id === car);
  if (own === (isThere ? car : null)) return;
  const before = own;
  own = isThere ? car : null;
  if (own !== null) {
    notice('');
    if (hasPictures) $('mode').value = 'chase';
    select(own);
    drive();
  } else if (selected === before) {
    stopDriving();
    selected = null;
    $('selected').textContent = 'Select a vehicle';
    $('drive').disabled = true;
    clear($('small'));
    if ($('mode').value === 'chase') clear($('large'));
    look();
  }
}

addEventListener('keydown', (event) => {
  if (driven === null) return;
  if (event.key === 'Escape') return stopDriving();
  if (!PEDAL_KEYS[event.code]) return;
  event.preventDefault();
  if (!event.repeat) { keys.add(PEDAL_KEYS[event.code]); pedals(); }
});
addEventListener('keyup', (event) => { if (keys.delete(PEDAL_KEYS[event.code])) pedals(); });
// A page that nobody looks at drives nothing.
addEventListener('blur', stopDriving);
document.addEventListener('visibilitychange', () => { if (document.hidden) stopDriving(); });

// By touch: the wheel follows a finger, and turns back without one; pedals count while they are held.
const touched = new Set();
let wheel = null;
function turn(share) {
  $('wheel').firstElementChild.style.transform = `translateX(${(share * ($('wheel').clientWidth / 2 - 24)).toFixed(0)}px)`;
  $('wheel').setAttribute('aria-valuenow', Math.round(share * 100));
}
$('wheel').addEventListener('pointerdown', (event) => { $('wheel').setPointerCapture(event.pointerId); follow(event); });
$('wheel').addEventListener('pointermove', (event) => { if (wheel !== null) follow(event); });
for (const end of ['pointerup', 'pointercancel']) $('wheel').addEventListener(end, () => { wheel = null; });
function follow(event) {
  const box = $('wheel').getBoundingClientRect();
  wheel = Math.max(-1, Math.min(1, (event.clientX - box.left - box.width / 2) / (box.width / 2 - 24)));
  event.preventDefault();
}
for (const button of document.querySelectorAll('[data-pedal]')) {
  const hold = (isHeld) => {
    touched[isHeld ? 'add' : 'delete'](button.dataset.pedal);
    button.classList.toggle('held', isHeld);
    pedals();
  };
  button.addEventListener('pointerdown', (event) => { button.setPointerCapture(event.pointerId); event.preventDefault(); hold(true); });
  for (const end of ['pointerup', 'pointercancel']) button.addEventListener(end, () => hold(false));
  button.addEventListener('contextmenu', (event) => event.preventDefault());
}
$('reverse').onclick = () => $('reverse').setAttribute('aria-pressed', $('reverse').getAttribute('aria-pressed') !== 'true');

function pedals() {
  if (driven === null) return;
  const has = (pedal) => keys.has(pedal) || touched.has(pedal);
  const reverse = keys.has('reverse') || $('reverse').getAttribute('aria-pressed') === 'true';
  send({ t: 'drive', vehicle: driven, pedals: { gas: has('gas') ? 0.6 : 0, brake: has('brake') ? 0.8 : 0,
    handbrake: has('handbrake') ? 1 : 0, steering_rad: steering, reverse } });
}

setInterval(() => {
  if (driven === null) return;
  const wanted = (keys.has('left') ? 1 : 0) - (keys.has('right') ? 1 : 0);
  const step = STEERING_RADPS * 0.04, goal = (wheel === null ? wanted : -wheel) * MAX_STEERING_RAD;
  steering += Math.max(-step, Math.min(step, goal - steering));
  turn(wheel ?? -steering / MAX_STEERING_RAD);
  pedals();
}, 40);
setInterval(() => send({ t: 'ping', sent_ms: performance.now() }), 2000);

connect();
