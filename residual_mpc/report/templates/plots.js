/* Linked plots over time, one a channel: one zoom, one cursor and one read-out for all of them. */
function linkedPlots(place, series) {
  "use strict";
  var W = 480, H = 210, L = 58, R = 16, T = 8, B = 30, NS = "http" + "://www.w3.org/2000/svg", count = 0;
  var state = { from: 0, to: 1, cursor: null }, all = [0, 1], drawn = [], name = "";
  linkedPlots.made = (linkedPlots.made || 0) + 1;
  var prefix = "plots" + linkedPlots.made + "-";

  function node(kind, attributes, parent) {
    var e = document.createElementNS(NS, kind);
    Object.keys(attributes).forEach(function (k) { e.setAttribute(k, attributes[k]); });
    if (parent) parent.appendChild(e);
    return e;
  }
  function short(v) { return v === null ? "\u2013" : v === 0 ? "0" : String(Number(v.toPrecision(3))); }
  function x(t) { return L + (W - L - R) * (t - state.from) / (state.to - state.from); }
  function nearest(t, at) {
    var low = 0, high = t.length - 1;
    while (high - low > 1) { var m = (low + high) >> 1; if (t[m] < at) low = m; else high = m; }
    return at - t[low] < t[high] - at ? low : high;
  }
  function ticks(from, to, about) {  // round numbers, about so many
    var raw = (to - from) / about, power = Math.pow(10, Math.floor(Math.log10(raw))), m = raw / power, out = [];
    var step = power * (m < 1.5 ? 1 : m < 3.5 ? 2 : m < 7.5 ? 5 : 10);
    for (var k = Math.ceil(from / step - 1e-9); raw > 0 && k * step <= to + 1e-9 * step; k++) out.push(k * step);
    return out;
  }
  function ends(look) {  // a nominal model that runs away leaves the picture
    function range(values, out) {
      if (values) values.forEach(function (v, k) {
        if (v !== null && look.t[k] >= state.from && look.t[k] <= state.to) { out[0] = Math.min(out[0], v); out[1] = Math.max(out[1], v); }
      });
      return out;
    }
    var own = range(look.values[0], [Infinity, -Infinity]);
    (look.frame || [look.values[2]]).forEach(function (v) { range(v, own); });
    var wild = range(look.values[1], [Infinity, -Infinity]), reach = 25 * (own[1] - own[0]);
    var low = Math.min(own[0], Math.max(wild[0], own[0] - reach)), high = Math.max(own[1], Math.min(wild[1], own[1] + reach));
    if (low > high) return [0, 1];
    var room = 0.06 * (high - low) || 1e-6;
    return [low - room, high + room];
  }
  function line(look, values, y) {  // broken where a window starts
    var d = "", pen = "M", starts = look.starts || [], s = 0;
    for (var k = 0; k < look.t.length; k++) {
      while (s < starts.length && starts[s] <= k) { if (starts[s] === k) pen = "M"; s++; }
      if (values[k] !== null) { d += pen + x(look.t[k]).toFixed(1) + " " + y(values[k]).toFixed(1); pen = "L"; }
    }
    return d;
  }
  function figure(look, i) {
    var f = document.createElement("figure"), caption = document.createElement("figcaption"), code = document.createElement("code");
    code.textContent = look.channel; caption.appendChild(code);
    var told = document.createElement("span"); told.className = "note told"; caption.appendChild(told);
    f.appendChild(caption);
    var id = prefix + (count++);
    var svg = node("svg", { viewBox: "0 0 " + W + " " + H, role: "img", tabindex: "0", "class": "plot" });
    node("rect", { x: L, y: T, width: W - L - R, height: H - T - B }, node("clipPath", { id: id }, svg));
    var axes = node("g", {}, svg), inside = node("g", { "clip-path": "url(#" + id + ")" }, svg);
    var lines = series.map(function (s) {
      return node("path", { fill: "none", stroke: s.stroke, "stroke-width": s.width, "stroke-dasharray": s.dash || "none", opacity: s.opacity || 1 }, inside);
    });
    var cursor = node("line", { y1: T, y2: H - B, stroke: "var(--ink)", "stroke-width": 1, visibility: "hidden" }, svg);
    var band = node("rect", { y: T, height: H - T - B, fill: "var(--after)", opacity: 0.15, visibility: "hidden" }, svg);
    f.appendChild(svg); place.appendChild(f);
    var d = { look: look, svg: svg, axes: axes, lines: lines, cursor: cursor, band: band, told: told, down: null };
    drawn.push(d); listen(d);
  }
  function at(d, event) {
    var r = d.svg.getBoundingClientRect(), px = (event.clientX - r.left) * W / r.width;
    return Math.min(state.to, Math.max(state.from, state.from + (px - L) / (W - L - R) * (state.to - state.from)));
  }
  function listen(d) {
    function let_go() { d.down = null; d.band.setAttribute("visibility", "hidden"); }
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
      var from = d.down, to = at(d, e);
      let_go();
      if (from !== null && Math.abs(to - from) > 0.02 * (state.to - state.from)) zoom(Math.min(from, to), Math.max(from, to));
    });
    d.svg.addEventListener("pointerleave", function () { let_go(); state.cursor = null; mark(); });
    d.svg.addEventListener("dblclick", whole);
    d.svg.addEventListener("keydown", function (e) {
      var step = (state.to - state.from) / 40, move = { ArrowLeft: -step, ArrowRight: step }[e.key];
      if (e.key === "+" || e.key === "=") scale(0.5);
      else if (e.key === "-") scale(2);
      else if (move !== undefined) {
        var now = state.cursor === null ? (state.from + state.to) / 2 : state.cursor;
        state.cursor = Math.min(state.to, Math.max(state.from, now + move));
        mark();
      } else return;
      e.preventDefault();
    });
  }
  function draw() {
    drawn.forEach(function (d) {
      var e = ends(d.look), y = function (v) { return H - B - (H - T - B) * (v - e[0]) / (e[1] - e[0]); };
      d.axes.textContent = "";
      ticks(e[0], e[1], 4).forEach(function (v) {
        node("line", { x1: L, x2: W - R, y1: y(v), y2: y(v), stroke: "var(--grid)" }, d.axes);
        node("text", { x: L - 6, y: y(v) + 4, "text-anchor": "end", "font-size": 12, fill: "var(--muted)" }, d.axes).textContent = short(v);
      });
      ticks(state.from, state.to, 4).forEach(function (s, k, them) {
        node("text", { x: x(s), y: H - 10, "text-anchor": "middle", "font-size": 12, fill: "var(--muted)" }, d.axes).textContent = short(s) + (k === them.length - 1 ? " s" : "");
      });
      series.forEach(function (s, i) { d.lines[i].setAttribute("d", d.look.values[i] ? line(d.look, d.look.values[i], y) : ""); });
      d.svg.setAttribute("aria-label", d.look.channel + " in " + name + ": " + series.map(function (s) { return s.label; }).join(", "));
    });
    mark();
  }
  function mark() {
    drawn.forEach(function (d) {
      if (state.cursor === null) { d.cursor.setAttribute("visibility", "hidden"); d.told.textContent = d.look.unit; return; }
      var k = nearest(d.look.t, state.cursor), px = x(d.look.t[k]);
      d.cursor.setAttribute("x1", px); d.cursor.setAttribute("x2", px); d.cursor.setAttribute("visibility", "visible");
      d.told.textContent = short(d.look.t[k]) + " s: " + series.map(function (s, i) {
        return d.look.values[i] ? s.label + " " + short(d.look.values[i][k]) : "";
      }).filter(Boolean).join(", ") + " " + d.look.unit;
    });
  }
  function zoom(from, to) {
    var width = Math.min(to - from, all[1] - all[0]);
    state.from = Math.max(all[0], Math.min(from, all[1] - width)); state.to = state.from + width;
    if (state.cursor !== null) state.cursor = Math.min(state.to, Math.max(state.from, state.cursor));
    draw();
    if (plots.zoomed) plots.zoomed(state.from, state.to);
  }
  function scale(f) { var m = state.cursor === null ? (state.from + state.to) / 2 : state.cursor, w = f * (state.to - state.from); zoom(m - w / 2, m + w / 2); }
  function shift(f) { var w = state.to - state.from; zoom(state.from + f * w, state.to + f * w); }
  function whole() { zoom(all[0], all[1]); }
  function show(looks, title) {
    place.textContent = ""; drawn = []; name = title; state.cursor = null;
    all = [looks[0].t[0], looks[0].t[looks[0].t.length - 1]]; state.from = all[0]; state.to = all[1];
    looks.forEach(figure); draw();
  }
  function buttons(box) {  // data-zoom="in", "out", "left", "right" or "whole"
    var does = { "in": function () { scale(0.5); }, out: function () { scale(2); }, left: function () { shift(-0.25); }, right: function () { shift(0.25); }, whole: whole };
    box.querySelectorAll("button[data-zoom]").forEach(function (b) { b.addEventListener("click", does[b.getAttribute("data-zoom")]); });
  }
  var plots = { show: show, draw: draw, zoom: zoom, buttons: buttons, zoomed: null };
  return plots;
}
var MEASURED = { label: "measured", stroke: "var(--ink)", width: 3, opacity: 0.55 };
var NOMINAL = { label: "nominal", stroke: "var(--before)", width: 1.8, dash: "6 3" };
function corrected(label) { return { label: label, stroke: "var(--after)", width: 2 }; }
