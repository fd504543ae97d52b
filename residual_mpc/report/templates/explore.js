(function () {
  "use strict";
  var data = JSON.parse(document.getElementById("explore-data").textContent);
  var box = document.getElementById("explorer"), panels = document.getElementById("explore-panels");
  var pick = document.getElementById("explore-view"), says = document.getElementById("explore-says");
  var inputs = Array.prototype.slice.call(box.querySelectorAll("input[type=range]"));
  var W = 480, H = 210, L = 58, R = 8, T = 8, B = 30, NS = "http" + "://www.w3.org/2000/svg";
  var state = { view: 0, slider: 0, from: 0, to: 1, cursor: null }, drawn = [];

  function node(name, attributes, parent) {
    var e = document.createElementNS(NS, name);
    Object.keys(attributes).forEach(function (k) { e.setAttribute(k, attributes[k]); });
    if (parent) parent.appendChild(e);
    return e;
  }
  function short(v) { return v === null ? "\u2013" : v === 0 ? "0" : String(Number(v.toPrecision(3))); }
  function view() { return data.views[state.view]; }
  function span() { var l = view().looks[0]; return [0, l.t[l.t.length - 1]]; }
  function curve(look) { return look.curves[state.slider][Number(inputs[state.slider].value)]; }
  function nearest(t, at) {
    var best = 0;
    for (var k = 1; k < t.length; k++) if (Math.abs(t[k] - at) < Math.abs(t[best] - at)) best = k;
    return best;
  }
  function ends(look) {
    var low = Infinity, high = -Infinity;
    function see(v, k) { if (v !== null && look.t[k] >= state.from && look.t[k] <= state.to) { low = Math.min(low, v); high = Math.max(high, v); } }
    look.measured.forEach(see); look.before.forEach(see);
    look.curves[state.slider].forEach(function (c) { c.forEach(see); });
    if (low > high) return [0, 1];
    var room = 0.06 * (high - low) || 1e-6;
    return [low - room, high + room];
  }
  function build() {
    panels.textContent = ""; drawn = [];
    view().looks.forEach(function (look, i) {
      var figure = document.createElement("figure"), caption = document.createElement("figcaption"), code = document.createElement("code");
      code.textContent = look.channel; caption.appendChild(code);
      var told = document.createElement("span"); told.className = "note"; caption.appendChild(told);
      figure.appendChild(caption);
      var svg = node("svg", { viewBox: "0 0 " + W + " " + H, role: "img", tabindex: "0", "class": "explore-plot" });
      var clip = node("clipPath", { id: "explore-clip-" + i }, svg);
      node("rect", { x: L, y: T, width: W - L - R, height: H - T - B }, clip);
      var axes = node("g", {}, svg), inside = node("g", { "clip-path": "url(#explore-clip-" + i + ")" }, svg);
      var lines = {
        measured: node("polyline", { fill: "none", stroke: "var(--ink)", "stroke-width": 3, opacity: 0.55 }, inside),
        before: node("polyline", { fill: "none", stroke: "var(--before)", "stroke-width": 1.8, "stroke-dasharray": "6 3" }, inside),
        after: node("polyline", { fill: "none", stroke: "var(--after)", "stroke-width": 2 }, inside)
      };
      var cursor = node("line", { y1: T, y2: H - B, stroke: "var(--ink)", "stroke-width": 1, visibility: "hidden" }, svg);
      var band = node("rect", { y: T, height: H - T - B, fill: "var(--after)", opacity: 0.15, visibility: "hidden" }, svg);
      figure.appendChild(svg); panels.appendChild(figure);
      var d = { look: look, svg: svg, axes: axes, lines: lines, cursor: cursor, band: band, told: told, down: null };
      drawn.push(d); listen(d);
    });
    draw();
  }
  function at(d, event) {
    var r = d.svg.getBoundingClientRect(), x = (event.clientX - r.left) * W / r.width;
    return Math.min(state.to, Math.max(state.from, state.from + (x - L) / (W - L - R) * (state.to - state.from)));
  }
  function listen(d) {
    d.svg.addEventListener("pointermove", function (e) {
      state.cursor = at(d, e);
      if (d.down !== null) {
        var a = x(Math.min(d.down, state.cursor)), b = x(Math.max(d.down, state.cursor));
        d.band.setAttribute("x", a); d.band.setAttribute("width", b - a); d.band.setAttribute("visibility", "visible");
      }
      mark();
    });
    d.svg.addEventListener("pointerdown", function (e) { if (e.pointerType !== "touch") d.down = at(d, e); });
    d.svg.addEventListener("pointerup", function (e) {
      var from = d.down, to = at(d, e), all = span();
      d.down = null; d.band.setAttribute("visibility", "hidden");
      if (from !== null && Math.abs(to - from) > 0.03 * (all[1] - all[0])) zoom(Math.min(from, to), Math.max(from, to));
    });
    d.svg.addEventListener("pointerleave", function () { d.down = null; d.band.setAttribute("visibility", "hidden"); state.cursor = null; mark(); });
    d.svg.addEventListener("keydown", function (e) {
      var step = (state.to - state.from) / 40, move = { ArrowLeft: -step, ArrowRight: step }[e.key];
      if (move === undefined) return;
      e.preventDefault();
      var now = state.cursor === null ? (state.from + state.to) / 2 : state.cursor;
      state.cursor = Math.min(state.to, Math.max(state.from, now + move));
      mark();
    });
  }
  function x(t) { return L + (W - L - R) * (t - state.from) / (state.to - state.from); }
  function ticks(from, to, about) {  // round numbers, about so many
    var raw = (to - from) / about, power = Math.pow(10, Math.floor(Math.log10(raw))), m = raw / power, out = [];
    var step = power * (m < 1.5 ? 1 : m < 3.5 ? 2 : m < 7.5 ? 5 : 10);
    for (var k = Math.ceil(from / step - 1e-9); raw > 0 && k * step <= to + 1e-9 * step; k++) out.push(k * step);
    return out;
  }
  function draw() {
    drawn.forEach(function (d) {
      var e = ends(d.look), y = function (v) { return H - B - (H - T - B) * (v - e[0]) / (e[1] - e[0]); };
      function points(values) {
        return values.map(function (v, k) { return v === null ? "" : x(d.look.t[k]).toFixed(1) + "," + y(v).toFixed(1); }).join(" ");
      }
      d.axes.textContent = "";
      ticks(e[0], e[1], 4).forEach(function (v) {
        node("line", { x1: L, x2: W - R, y1: y(v), y2: y(v), stroke: "var(--grid)" }, d.axes);
        node("text", { x: L - 6, y: y(v) + 4, "text-anchor": "end", "font-size": 12, fill: "var(--muted)" }, d.axes).textContent = short(v);
      });
      ticks(state.from, state.to, 4).forEach(function (s) {
        node("text", { x: x(s), y: H - 8, "text-anchor": "middle", "font-size": 12, fill: "var(--muted)" }, d.axes).textContent = short(s);
      });
      node("text", { x: W - R, y: H - B - 6, "text-anchor": "end", "font-size": 12, fill: "var(--muted)" }, d.axes).textContent = "time (s)";
      d.lines.measured.setAttribute("points", points(d.look.measured));
      d.lines.before.setAttribute("points", points(d.look.before));
      d.lines.after.setAttribute("points", points(curve(d.look)));
      d.svg.setAttribute("aria-label", d.look.channel + " in " + view().name + ": measured, nominal model, and with the value of the slider");
    });
    var s = data.sliders[state.slider], i = Number(inputs[state.slider].value);
    says.textContent = s.name + " " + s.labels[i] + (i === s.fitted ? " (fitted)" : s.inside[i] ? " (inside the 95 % interval)" : " (outside the 95 % interval)") +
      ": gap " + view().gaps[state.slider][i] + " in this window, " + s.gaps[i] + " over the held-out windows.";
    mark();
  }
  function mark() {
    drawn.forEach(function (d) {
      if (state.cursor === null) { d.cursor.setAttribute("visibility", "hidden"); d.told.textContent = d.look.unit; return; }
      var k = nearest(d.look.t, state.cursor), place = x(d.look.t[k]);
      d.cursor.setAttribute("x1", place); d.cursor.setAttribute("x2", place); d.cursor.setAttribute("visibility", "visible");
      d.told.textContent = short(d.look.t[k]) + " s: measured " + short(d.look.measured[k]) + ", nominal " + short(d.look.before[k]) +
        ", slider " + short(curve(d.look)[k]) + " " + d.look.unit;
    });
  }
  function zoom(from, to) {
    var all = span(), width = Math.min(to - from, all[1] - all[0]);
    state.from = Math.max(all[0], Math.min(from, all[1] - width)); state.to = state.from + width;
    draw();
  }
  function scale(f) { var m = state.cursor === null ? (state.from + state.to) / 2 : state.cursor, w = f * (state.to - state.from); zoom(m - w / 2, m + w / 2); }
  function shift(f) { var w = state.to - state.from; zoom(state.from + f * w, state.to + f * w); }
  function show(index) { state.view = index; var all = span(); state.from = all[0]; state.to = all[1]; state.cursor = null; build(); }

  data.views.forEach(function (v, k) { var o = document.createElement("option"); o.value = k; o.textContent = v.name; pick.appendChild(o); });
  pick.addEventListener("change", function () { show(Number(pick.value)); });
  function set(k, value) {
    inputs[k].value = value;
    inputs[k].nextElementSibling.textContent = data.sliders[k].labels[Number(value)];
    inputs[k].setAttribute("aria-valuetext", data.sliders[k].labels[Number(value)]);
  }
  inputs.forEach(function (input, k) {
    set(k, data.sliders[k].fitted);
    input.addEventListener("input", function () {
      inputs.forEach(function (other, i) { set(i, i === k ? input.value : data.sliders[i].fitted); });
      state.slider = k; draw();
    });
  });
  document.getElementById("explore-in").addEventListener("click", function () { scale(0.5); });
  document.getElementById("explore-out").addEventListener("click", function () { scale(2); });
  document.getElementById("explore-left").addEventListener("click", function () { shift(-0.25); });
  document.getElementById("explore-right").addEventListener("click", function () { shift(0.25); });
  box.hidden = false;
  show(0);
})();
