'use strict';
const tip = document.getElementById('tip');
const small = new Viewer(tip.firstChild, DATA.scene);
for (const canvas of document.querySelectorAll('canvas[data-grasp]')) {
  const viewer = new Viewer(canvas, DATA.scene);
  viewer.interactive();
  viewer.show(DATA.scene.grasps[+canvas.dataset.grasp]);
}
let shown = -1;
document.addEventListener('mousemove', e => {
  const target = e.target.closest && e.target.closest('svg [data-grasp]');
  if (!target) { tip.style.display = 'none'; shown = -1; return; }
  const n = +target.dataset.grasp;
  if (n !== shown) {
    shown = n; small.reset(); small.show(DATA.scene.grasps[n]);
    tip.lastChild.textContent = target.dataset.text || DATA.scene.grasps[n].id;
  }
  tip.style.display = 'block';
  tip.style.left = Math.min(e.clientX + 14, innerWidth - 275) + 'px';
  tip.style.top = Math.max(4, Math.min(e.clientY + 14, innerHeight - 320)) + 'px';
});
