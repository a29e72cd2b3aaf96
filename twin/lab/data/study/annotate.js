'use strict';
const BROAD = [
  ['power', 'The hand holds the object rigidly; only the arm can move it.'],
  ['intermediate', 'Something of both: often between the thumb and the side of a finger.'],
  ['precision', 'The object sits between fingertips, which could move it within the hand.'],
];
const KEYS = '1234567890';
const STORE = 'ftac-annotation:' + DATA.title;
const $ = id => document.getElementById(id);
const grasps = DATA.scene.grasps;
let state = { at: 0, annotator: '', labels: {} };
try { state = Object.assign(state, JSON.parse(localStorage.getItem(STORE) || '{}')); } catch (e) { /* a fresh start */ }
if (!(state.at >= 0 && state.at < grasps.length)) state.at = 0;
let broad = null;
const viewer = new Viewer($('view'), DATA.scene);
viewer.interactive();
const keep = () => { try { localStorage.setItem(STORE, JSON.stringify(state)); } catch (e) { /* shown by the count only */ } };

// Pictures of the types: the hand in a typical posture around a simple body.
function body(e) {
  const v = [], f = [], [a, b, c] = e.size.map(x => x * 1e4), put = (x, y, z) => v.push(Math.round(x), Math.round(y), Math.round(z));
  const N = 20, M = e.object === 'ball' ? 10 : 1;
  if (e.object === 'slab') {
    for (const x of [-a, a]) for (const y of [-b, b]) for (const z of [-c, c]) put(x, y, z);
    f.push(0, 1, 3, 0, 3, 2, 4, 6, 7, 4, 7, 5, 0, 4, 5, 0, 5, 1, 2, 3, 7, 2, 7, 6, 0, 2, 6, 0, 6, 4, 1, 5, 7, 1, 7, 3);
  } else {
    for (let i = 0; i <= M; i++) for (let k = 0; k < N; k++) {
      const t = 2 * Math.PI * k / N, s = e.object === 'ball' ? Math.sin(Math.PI * i / M) : 1;
      const h = e.object === 'ball' ? -Math.cos(Math.PI * i / M) * a : (2 * i - 1) * b;
      put(a * s * Math.cos(t), a * s * Math.sin(t), h);
    }
    for (let i = 0; i < M; i++) for (let k = 0; k < N; k++) {
      const p = i * N + k, q = i * N + (k + 1) % N;
      f.push(p, q, q + N, p, q + N, p + N);
    }
    if (e.object !== 'ball') for (const i of [0, N]) for (let k = 1; k < N - 1; k++) f.push(i, i + k, i + k + 1);
  }
  return { v, f };
}
function example(name) {
  const e = DATA.examples[name], q = [];
  e.bends.forEach((bend, digit) => { if (digit === 0) q.push(e.opposition, bend, bend); else q.push(...(Array.isArray(bend) ? bend : [bend, bend, bend * 0.8])); });
  const h = Math.SQRT1_2, pose = { x: [0, h, 0, h], y: [-h, 0, 0, h], z: [0, 0, 0, 1] }[e.axis];
  return { p: [...e.at, ...pose], q, c: [], mesh: body(e) };
}

function buttons() {
  $('broad').replaceChildren(...BROAD.map(([name, what]) => {
    const b = document.createElement('button');
    b.id = 'broad-' + name; b.innerHTML = `<kbd>${{ power: 'w', intermediate: 'i', precision: 'r' }[name]}</kbd> ${name}`;
    b.title = what; b.onclick = () => choose(name);
    return b;
  }));
}
function choose(name) {
  broad = name;
  for (const [other] of BROAD) $('broad-' + other).classList.toggle('on', other === name);
  $('what').textContent = name ? BROAD.find(b => b[0] === name)[1] : 'First: power (w), intermediate (i) or precision (r)?';
  const own = DATA.types.filter(t => t.category === name), label = state.labels[grasps[state.at].id];
  $('types').replaceChildren(...own.map((kind, n) => {
    const b = document.createElement('button'), picture = document.createElement('canvas'), text = document.createElement('div');
    b.id = 'type-' + kind.name.replace(/ /g, '-'); picture.width = picture.height = 168;
    text.innerHTML = '<b></b><span></span>';
    text.firstChild.textContent = `${KEYS[n]}  ${kind.name}`;
    text.lastChild.textContent = kind.definition + (kind.includes.length > 1 ? ` (${kind.includes.join(', ')})` : '');
    b.append(picture, text); b.classList.toggle('on', kind.name === label); b.onclick = () => label_as(kind.name);
    const small = new Viewer(picture, DATA.scene);
    small.zoom = 1.3; small.rotate(-0.7, 0.25); small.show(example(kind.name));
    return b;
  }));
}
function label_as(name) { state.labels[grasps[state.at].id] = name; keep(); go(state.at + 1 < grasps.length ? state.at + 1 : state.at); }
function go(n) {
  state.at = Math.min(Math.max(n, 0), grasps.length - 1); keep();
  const grasp = grasps[state.at], label = state.labels[grasp.id], kind = DATA.types.find(t => t.name === label);
  viewer.show(grasp);
  $('name').textContent = `${state.at + 1} of ${grasps.length}: ${grasp.id}${label ? ' is ' + label : ''}`;
  const done = Object.keys(state.labels).length;
  $('progress').value = done / grasps.length; $('count').textContent = `${done} labelled, ${grasps.length - done} to go`;
  choose(kind ? kind.category : null);
}
function open_one() {
  for (let k = 1; k <= grasps.length; k++) { const n = (state.at + k) % grasps.length; if (!state.labels[grasps[n].id]) return go(n); }
}
function toggle(what) { viewer.on[what] = !viewer.on[what]; $(what).classList.toggle('on', viewer.on[what]); viewer.draw(); }
function exported() { return JSON.stringify({ version: DATA.version, annotator: state.annotator || 'unnamed', labels: state.labels }, null, 1); }
for (const what of ['hand', 'object', 'contacts']) $(what).onclick = () => toggle(what);
$('back').onclick = () => go(state.at - 1); $('next').onclick = () => go(state.at + 1); $('open').onclick = open_one;
$('clear').onclick = () => { delete state.labels[grasps[state.at].id]; keep(); go(state.at); };
$('annotator').value = state.annotator; $('annotator').oninput = e => { state.annotator = e.target.value.trim(); keep(); };
$('export').onclick = () => {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(new Blob([exported()], { type: 'application/json' }));
  link.download = `labels-${state.annotator || 'unnamed'}.json`; link.click(); URL.revokeObjectURL(link.href);
};
addEventListener('keydown', e => {
  if (e.target.tagName === 'INPUT' || e.ctrlKey || e.metaKey || e.altKey) return;
  const n = KEYS.indexOf(e.key), own = DATA.types.filter(t => t.category === broad);
  if (e.key === 'w') choose('power'); else if (e.key === 'i') choose('intermediate'); else if (e.key === 'r') choose('precision');
  else if (n >= 0 && broad && own[n]) label_as(own[n].name);
  else if (e.key === 'ArrowLeft') go(state.at - 1); else if (e.key === 'ArrowRight') go(state.at + 1);
  else if (e.key === 'h') toggle('hand'); else if (e.key === 'o') toggle('object'); else if (e.key === 'c') toggle('contacts');
  else if (e.key === 'u') open_one(); else if (e.key === 'x') $('clear').click();
  else return;
  e.preventDefault();
});
buttons();
go(state.at);
