// SPDX-License-Identifier: Apache-2.0
// This is the script of the page of `ubs report`. It builds the sections from the record and the images in
// the page, and draws the charts with Chart.js. Names of runs, views and settings come from users, so every
// text is inserted as a text node, never as markup.
'use strict';
{
  const record = JSON.parse(document.getElementById('ubs-record').textContent);
  const pictures = JSON.parse(document.getElementById('ubs-pictures').textContent);
  const runs = record.runs, several = runs.length > 1;
  // The colours of the runs. They are from the palette of Okabe and Ito, which colour-blind readers can
  // distinguish. Some are darkened, because they would be too pale on white.
  const colours = ['#0072b2', '#d55e00', '#009e73', '#b0538c', '#b97f00', '#2f8fc4', '#5a5a5a'];
  const colour = (run) => colours[run % colours.length];
  const nothing = '\u2013', mib = 1 << 20;

  // ---- Reading of the record. Runs of other versions may lack fields, or contain values of other types.
  const dict = (value) => (value && typeof value === 'object' && !Array.isArray(value) ? value : {});
  const list = (value) => (Array.isArray(value) ? value : []);
  const member = (value, key) => (Object.hasOwn(dict(value), key) ? value[key] : undefined);
  const find = (run, ...path) => path.reduce(member, run.metrics);
  const isNumber = (value) => typeof value === 'number';
  const unique = (items) => [...new Set(items)];

  // ---- Elements of the page.
  const element = (name, attributes, ...children) => {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...children.flat(9).filter((child) => child !== null && child !== undefined));
    return made;
  };
  const of = (style, ...children) => element('div', {class: style}, children);
  const note = (...children) => element('p', {class: 'note'}, children);
  const toned = (made, run) => {
    made.style.setProperty('--tone', colour(run));
    return made;
  };
  const runLabel = (run) => toned(element('span', {class: 'run'}, runs[run].name), run);
  const labelled = (run, ...children) => (several ? [runLabel(run), ' ', children] : children);
  const legend = (...more) => of('legend', several ? runs.map((_, r) => runLabel(r)) : null, more);
  // A cell is a string, an element, or [content, style]. Rows are arrays of cells; the first cell of a row is its
  // heading.
  const table = (head, rows, rowStyle = () => '') => {
    const cell = (name, content) => {
      const [inside, style] = Array.isArray(content) ? content : [content, ''];
      return element(name, style ? {class: style} : {}, inside);
    };
    const body = rows.map(
        (row, r) => element(
            'tr', rowStyle(r) ? {class: rowStyle(r)} : {},
            row.map((content, c) => cell(c === 0 ? 'th' : 'td', content))));
    return of(
        'scroll',
        element(
            'table', {},
            head ? element('thead', {}, element('tr', {}, head.map((content) => cell('th', content)))) : null,
            element('tbody', {}, body)));
  };
  const headOf = (first) => [first, ...runs.map((_, r) => runLabel(r))];

  // ---- Formats of numbers.
  const compact = new Intl.NumberFormat('en', {notation: 'compact', maximumSignificantDigits: 3});
  const digits = new Intl.NumberFormat('en', {maximumSignificantDigits: 3, useGrouping: false});
  const short = (v) => {
    if (v !== 0 && (Math.abs(v) < 1e-3 || Math.abs(v) >= 1e12))
      return v.toExponential(2).replace(/\.?0+e/, 'e').replace('e+', 'e');
    return Math.abs(v) >= 1e4 ? compact.format(v) : digits.format(v);
  };
  const fixed = (v, decimals) => v.toLocaleString('en', {
                                    minimumFractionDigits: decimals,
                                    maximumFractionDigits: decimals
                                  }).replaceAll(',', '\u2009');
  const valueText = (value, key) => {
    if (value === null || value === undefined || value === '') return nothing;
    if (typeof value === 'string') return value;
    return isNumber(value) && key.endsWith('_bytes') ? `${fixed(value / mib, 1)} MiB` : JSON.stringify(value);
  };

  // ---- Charts.
  const charts = [];
  Object.assign(Chart.defaults.font, {family: getComputedStyle(document.body).fontFamily, size: 11.5});
  Chart.defaults.color = '#5b6470';
  Chart.defaults.animation = false;
  // The tooltip shows the nearest point of every line, because different runs have points at different x.
  Chart.Interaction.modes.eachLine = (chart, event) =>
      chart.getSortedVisibleDatasetMetas().flatMap((meta) => {
        const distance = (point) => Math.abs(point.x - event.x);
        const index =
            meta.data.reduce((best, point, i) => (distance(point) < distance(meta.data[best]) ? i : best), 0);
        return meta.data.length && !chart.data.datasets[meta.index].faint ?
            [{element: meta.data[index], datasetIndex: meta.index, index}] :
            [];
      });
  // Logarithmic axes have labels only at 1, 2 and 5 times a power of ten, or only at the powers if there are
  // four or more of them.
  const logTick = (value, _, ticks) => {
    const leading = (v) => Math.round(v / 10 ** Math.floor(Math.log10(v) + 1e-9) * 10) / 10;
    const powers = ticks.filter((t) => leading(t.value) === 1).length;
    if (powers >= 4 ? leading(value) === 1 : [1, 2, 5].includes(leading(value)) || powers === 0)
      return short(value);
    return null;
  };
  const axis = (title, log, more) => ({
    type: log ? 'logarithmic' : 'linear',
    title: {display: true, text: title},
    grid: {color: '#eceff2'},
    ticks:
        {maxRotation: 0, maxTicksLimit: log ? 40 : 7, autoSkipPadding: 14, callback: log ? logTick : short},
    ...more,
  });
  const addChart = (title, x, y, datasets, tooltipTitle) => {
    const canvas = element('canvas', {role: 'img', 'aria-label': title});
    const figure = element('figure', {}, element('h3', {}, title), of('plot', canvas));
    const label = (item) => `${several ? `${item.dataset.label}: ` : ''}${
        fixed(item.parsed.y, Math.abs(item.parsed.y) < 10 ? 4 : 2)}`;
    const options = {
      responsive: true,
      maintainAspectRatio: false,
      parsing: false,
      normalized: true,
      scales: {x, y},
      interaction: {mode: 'eachLine'},
      plugins: {
        legend: {display: false},
        decimation: {enabled: true, algorithm: 'min-max'},
        tooltip: {callbacks: {title: tooltipTitle, label}, boxPadding: 4}
      },
    };
    charts.push({canvas, config: {type: 'line', data: {datasets}, options}});
    return figure;
  };
  // A chart measures its element, so it is created after the element was added to the document.
  const showCharts = () => {
    for (const chart of charts) chart.shown = new Chart(chart.canvas, chart.config);
  };
  for (const event of ['beforeprint', 'afterprint'])
    addEventListener(event, () => charts.forEach((chart) => chart.shown.resize()));

  // ---- Sections. Each function returns the content of a section, or nothing if there is nothing to show.
  const measures = {
    psnr: ['PSNR, mean over channels', 'dB', 3, 1],
    psnr_joint: ['PSNR, joint', 'dB', 3, 1],
    ssim: ['SSIM', '', 4, 1],
    ssim_valid: ['SSIM, windows inside the image', '', 4, 1],
  };
  const measure = (name) =>
      (Object.hasOwn(measures, name) ? measures[name] : [name, '', 5, name.startsWith('lpips') ? -1 : 0]);
  const measureNames = () => unique(runs.flatMap((run) => {
    const mean = dict(find(run, 'test', 'mean'));
    return Object.keys(mean).filter((key) => isNumber(mean[key]));
  }));
  const measuredViews = (run) =>
      list(find(run, 'test', 'views')).filter((view) => typeof dict(view).name === 'string');
  const stateOf = (run) =>
      (run.metrics === null                  ? 'not finished' :
           find(run, 'interrupted') === true ? 'interrupted' :
           find(run, 'ended_early')          ? 'finished early' :
                                               'finished');

  // Each entry contains the name, the unit, the number of decimals, the direction, a factor, and the path in
  // metrics.json. The direction is 1 if larger values are better, -1 if smaller values are better, and 0 otherwise. The
  // value in metrics.json times the factor is the value in the unit.
  const quantities = () =>
      [...measureNames().map((name) => [...measure(name), 1, 'test', 'mean', name]),
       ['PSNR from the poses that fit best', 'dB', 3, 1, 1, 'test', 'mean', 'fitted_pose', 'psnr'],
       ['splats', '', 0, 0, 1, 'splats'],
       ['live splats practically equal to another one', '%', 1, -1, 100, 'doubles'],
       ['dimensions N', '', 0, 0, 1, 'dim'],
       ['iterations', '', 0, 0, 1, 'iterations'],
       ['training', 's', 1, -1, 1, 'seconds'],
       ['step', 'ms', 3, -1, 1, 'actual', 'step_ms'],
       ['intersections per view, mean', '', 0, 0, 1, 'actual', 'mean_intersections'],
       ['intersections per view, maximum', '', 0, 0, 1, 'actual', 'most_intersections'],
       ['model file', 'MiB', 2, -1, 1 / mib, 'storage_bytes'],
       ['peak device memory', 'MiB', 1, -1, 1 / mib, 'peak_device_bytes'],
       ['device memory, estimated before training', 'MiB', 1, 0, 1 / mib, 'predicted_device_bytes'],
       ['extent of the cameras', 'scene units', 3, 0, 1, 'extent'],
       ['rollbacks', '', 0, -1, 1, 'rollbacks'],
       ['splats dropped', '', 0, -1, 1, 'dropped_splats'],
       ['resumed from iteration', '', 0, 0, 1, 'resumed_from'],
  ];
  // Returns whether the run was measured on images of a different size than the first run. If so, the measurements of
  // the two runs cannot be compared, because the same model has a different PSNR on smaller images.
  const otherSize = (r) => {
    const sizes = (view) => [0, r].map((run) => view.runs.find((own) => own.run === run)),
          different = ([a, b]) => a && b && (a.width !== b.width || a.height !== b.height),
          reduced = [0, r].map((run) => member(runs[run].settings, 'downscale'));
    return record.views.some((view) => different(sizes(view))) ||
        (reduced[0] !== reduced[1] && find(runs[0], 'data') === find(runs[r], 'data'));
  };
  const quantityRow = ([name, unit, decimals, better, scale, ...path]) => {
    const values = runs.map((run) => find(run, ...path)).map((v) => (isNumber(v) ? v * scale : null));
    if (values.every((value) => value === null)) return null;
    const cells = values.map((value, r) => {
      if (value === null) return [nothing, several ? 'number' : ''];
      if (r === 0 || values[0] === null) return [fixed(value, decimals), several ? 'number' : ''];
      if (path[0] === 'test' && otherSize(r))
        return [
          [fixed(value, decimals), ' ', element('span', {class: 'same'}, 'different image sizes')], 'number'
        ];
      const by = value - values[0], size = fixed(Math.abs(by), decimals);
      const same = !/[1-9]/.test(size), shown = (same ? '\u00b1' : by < 0 ? '\u2212' : '+') + size;
      const style = better === 0 || same ? 'same' : by * better > 0 ? 'better' : 'worse';
      return [[fixed(value, decimals), ' ', element('span', {class: style}, shown)], 'number'];
    });
    return [unit ? `${name} [${unit}]` : name, ...cells];
  };
  const textRow =
      (name, ...path) => [name, ...runs.map((run) => valueText(find(run, ...path), path[path.length - 1]))];

  const onCards = [
    'PSNR, mean over channels', 'PSNR from the poses that fit best', 'SSIM', 'splats', 'dimensions N',
    'iterations', 'training', 'model file'
  ];
  const card = (value, name) => of('card', element('b', {}, value), element('span', {}, name));
  const cards = (run) =>
      of('cards', quantities().map(([name, unit, decimals, , scale, ...path]) => {
        const value = find(run, ...path);
        return onCards.includes(name) && isNumber(value) ?
            card(`${fixed(value * scale, decimals)} ${unit}`, name) :
            null;
      }),
         card(stateOf(run), 'state'));

  const summary = () => {
    const rows = [
      ['state', ...runs.map(stateOf)],
      ...quantities().map(quantityRow).filter((row) => row),
      textRow('data', 'data'),
      textRow('layout', 'data_report', 'layout'),
      textRow('device', 'device', 'name'),
      textRow('version', 'version'),
      textRow('build', 'build'),
    ];
    if (several)
      return [
        note('Small numbers show the difference from the first run; green means better.'),
        table(headOf(''), rows)
      ];
    const half = Math.ceil(rows.length / 2);
    return [cards(runs[0]), of('side', table(null, rows.slice(0, half)), table(null, rows.slice(half)))];
  };

  // Replaces every value by the mean of itself and up to `reach` values on each side. The number of values is the same
  // on both sides, and is smaller near the ends, so that values near the ends are not pulled towards their inner
  // neighbours.
  const smoothed = (points, reach) => points.map((point, i) => {
    const near = Math.min(reach, i, points.length - 1 - i), window = points.slice(i - near, i + near + 1);
    return {x: point.x, y: window.reduce((sum, p) => sum + p.y, 0) / window.length};
  });
  // Returns the lines of a curve over the column `along` of log.csv. If the loss of a run has more than 20 values, it
  // has two lines: the logged values and the smoothed values.
  const linesOf = (curve, along) => runs.flatMap((run, r) => {
    const log = dict(run.log);
    const points = list(log[curve.column])
                       .map((y, i) => ({x: log[along][i], y}))
                       .filter(({x, y}) => isNumber(x) && isNumber(y) && !(curve.log && y <= 0));
    const tone = colour(r);
    const line =
        {label: run.name, borderColor: tone, backgroundColor: tone, borderWidth: 2, pointHitRadius: 8};
    if (!curve.log || points.length <= 20) return [{...line, data: points, pointRadius: curve.dots ? 3 : 0}];
    return [
      {...line, data: smoothed(points, 1 + Math.floor(points.length / 80)), pointRadius: 0},
      {...line, data: points, borderColor: `${tone}40`, borderWidth: 1, pointRadius: 0, faint: true},
    ];
  });
  const along = {iteration: 'iteration', seconds: 'seconds of training'};
  const addCurve = (curve) => {
    const lines = linesOf(curve, 'iteration');
    if (!lines.some((line) => line.data.length > 1)) return null;
    const lowest = lines.flatMap((line) => line.data).reduce((least, p) => Math.min(least, p.y), Infinity);
    const x = axis(along.iteration, false, {min: 0});
    const y = axis(curve.unit, curve.log, curve.log ? {min: 0.9 * lowest} : {});
    const title = (items) => items.map((item) => `${x.title.text} ${short(item.parsed.x)}`).slice(0, 1);
    curve.figure = addChart(curve.title, x, y, lines, title);
    curve.chart = charts[charts.length - 1];
    curve.x = x;
    return curve;
  };
  const curves = () => {
    const shown = [
      {column: 'loss', title: 'training loss', unit: 'loss', log: true},
      {column: 'test_psnr', title: 'PSNR of the test views', unit: 'dB', dots: true},
      {column: 'sample_psnr', title: 'PSNR of a few of the test views', unit: 'dB', dots: true},
      {column: 'test_ssim', title: 'SSIM of the test views', unit: 'SSIM', dots: true},
      {column: 'splats', title: 'splats', unit: 'splats'},
    ].map(addCurve).filter((curve) => curve);
    if (shown.length === 0) return null;
    const buttons = Object.entries(along).map(([column, name]) => {
      const button = element('button', {type: 'button', 'aria-pressed': column === 'iteration'}, name);
      button.addEventListener('click', () => {
        for (const other of buttons) other.setAttribute('aria-pressed', other === button);
        for (const curve of shown) {
          curve.x.title.text = name;
          curve.chart.shown.options.scales.x.title.text = name;
          curve.chart.shown.data.datasets = linesOf(curve, column);
          curve.chart.shown.update();
        }
      });
      return button;
    });
    return [
      legend(element('span', {class: 'choice'}, buttons)),
      of('charts', shown.map((curve) => curve.figure)),
      note('Pale lines show the logged loss, bold lines its running mean.'),
    ];
  };

  // The panes of a set share one zoom and position. Positions are stored as fractions of the pane size, because
  // panes differ in size. The wheel scrolls the page until the mouse has been moved over a pane, so that
  // scrolling past images does not zoom them.
  let armed = false;
  addEventListener('scroll', () => {
    armed = false;
  }, {passive: true});
  const zoomSet = (columns, width, height, content) => {
    const set = of('panes', content), readout = element('p', {class: 'readout'}, '\u00a0');
    set.style.setProperty('--columns', columns);
    const panes = [...set.querySelectorAll('.pane')];
    let zoom = 1, left = 0, top = 0, drag = null;
    const clamp = (v) => Math.min(0, Math.max(1 - zoom, v));
    const place = (e, pane) => {
      const box = pane.getBoundingClientRect();
      return [(e.clientX - box.left) / box.width, (e.clientY - box.top) / box.height];
    };
    const show = () => {
      left = clamp(left);
      top = clamp(top);
      for (const pane of panes)
        pane.firstElementChild.style.transform = `translate(${100 * left}%, ${100 * top}%) scale(${zoom})`;
    };
    const point = (x, y) => {
      for (const pane of panes) {
        pane.classList.add('at');
        pane.lastElementChild.style.left = `${100 * x}%`;
        pane.lastElementChild.style.top = `${100 * y}%`;
      }
      const at = (v, size) => Math.max(0, Math.min(size - 1, Math.floor(v * size)));
      readout.textContent =
          `pixel ${at((x - left) / zoom, width)}, ${at((y - top) / zoom, height)}, zoom ${zoom.toFixed(1)}`;
    };
    for (const pane of panes) {
      pane.addEventListener('wheel', (e) => {
        const next = Math.min(64, Math.max(1, zoom * Math.exp(-e.deltaY * (e.deltaMode ? 0.06 : 0.002))));
        if (!armed || next === zoom) return;
        e.preventDefault();
        const [x, y] = place(e, pane);
        left = x - (x - left) / zoom * next;
        top = y - (y - top) / zoom * next;
        zoom = next;
        show();
        point(x, y);
      }, {passive: false});
      pane.addEventListener('pointerdown', (e) => {
        drag = place(e, pane);
        pane.setPointerCapture(e.pointerId);
        e.preventDefault();
      });
      pane.addEventListener('pointermove', (e) => {
        if (e.movementX || e.movementY) armed = true;
        const [x, y] = place(e, pane);
        if (drag) {
          left += x - drag[0];
          top += y - drag[1];
          drag = [x, y];
          show();
        }
        point(x, y);
      });
      for (const end of ['pointerup', 'pointercancel'])
        pane.addEventListener(end, () => {
          drag = null;
        });
      pane.addEventListener('dblclick', () => {
        zoom = 1;
        left = top = 0;
        show();
      });
      pane.addEventListener('pointerleave', () => {
        for (const other of panes) other.classList.remove('at');
        readout.textContent = '\u00a0';
      });
    }
    return [set, readout];
  };
  const pane = (picture, alt, size, ...caption) => {
    const frame =
        of('pane', element('img', {src: pictures[picture], alt, decoding: 'async'}), element('i', {}));
    frame.style.aspectRatio = `${size.width} / ${size.height}`;
    return element('figure', {}, frame, element('figcaption', {}, caption));
  };
  const scale = (style, low, high) =>
      element('span', {class: 'scale'}, low, element('i', {class: style}), high);

  const viewPane = (view, own, kind) => {
    if (kind === 'truth') return pane(own.truth, 'ground truth', own, 'ground truth');
    const psnr = own.psnr === undefined ? '' : own.psnr === null ? ', exact' : `, ${own.psnr.toFixed(2)} dB`;
    const [near, far] = view.depth_range;
    const text = {render: `render${psnr}`, depth: `depth ${short(near)} to ${short(far)}`};
    return pane(own[kind], kind, own, labelled(own.run, text[kind] ?? kind));
  };
  const facts = (view) => {
    const measured = measuredViews(runs[0]).find((own) => own.name === view.name);
    if (!measured) return null;
    const rows = Object.entries(measured)
                     .filter(([, value]) => isNumber(value))
                     .map(([key, value]) => [measure(key)[0], [fixed(value, measure(key)[2]), 'number']]);
    return element(
        'figure', {class: 'facts'}, element('figcaption', {}, 'measured at the end of training'),
        table(null, rows));
  };
  // With one run, shows its images and its measurements. With several runs, shows one row per run and the
  // ground truth only once.
  const viewBlock = (view) => {
    const kinds = ['truth', 'render', 'error', 'depth', 'alpha'].filter(
        (kind) => kind === 'truth' || view.runs.some((own) => isNumber(own[kind])));
    const blank = (text) => element('figure', {class: 'blank'}, element('figcaption', {}, text));
    const cell = (own, kind, i) => {
      if (!isNumber(own[kind])) return blank(kind === 'truth' ? 'no ground truth' : nothing);
      if (kind === 'truth' && i > 0 && own.truth === view.runs[i - 1].truth)
        return blank('ground truth as above');
      return viewPane(view, own, kind);
    };
    const cells = view.runs.map((own, i) => kinds.map((kind) => cell(own, kind, i)));
    return [
      element('h3', {}, 'time' in view ? `${view.name} at time ${short(view.time)}` : view.name),
      zoomSet(
          several ? kinds.length : 3, view.runs[0].width, view.runs[0].height,
          [cells, several ? null : facts(view)])
    ];
  };
  const views = () =>
      (record.views.length ?
           [
             runs.map((run, r) => (run.views_from ? note(labelled(r, run.views_from)) : null)),
             note('The mouse wheel zooms all images of a view. Dragging moves them, and a double click resets them.'),
             note(
                 scale('error', 'error 0', `${record.error_top} (mean of |difference|, colours 0 to 1)`), ' ',
                 scale('depth', 'depth near', 'far')),
             record.views.map(viewBlock),
           ] :
           null);

  const kinds = {
    spatial: 'spatial beta: low values show smooth surfaces, high values show fine texture',
    angular: 'angular betas: low values show diffuse colour, high values show colour that depends on the view',
    temporal: 'temporal beta: low values show static parts, high values show moving parts',
  };
  const percent = (part) => `${Math.round(100 * part.low)} to ${Math.round(100 * part.high)} %`;
  const decomposition = () => (
      record.decompositions.length ?
          [
            note('Each part shows only the splats whose betas are in a range of quantiles.'),
            record.decompositions.map(
                (d) =>
                    [element('h3', {}, labelled(d.run, `view ${d.view}, ${kinds[d.kind]}`)),
                     d.meaningful ?
                         null :
                         element(
                             'p', {class: 'warn'},
                             'All betas are equal, so the splats are divided only by their order in the file.'),
                     zoomSet(
                         4, d.width, d.height,
                         d.parts.map(
                             (part) => pane(
                                 part.picture, part.name, d,
                                 'splats' in part ? `${part.name} (${percent(part)}): ${part.splats} splats` :
                                                    part.name))),
  ]),
          ] :
          null);

  const times = () =>
      (record.times.length ?
           [
             note('The camera of the first view is fixed while time passes from 0 to 1.'),
             record.times.map(
                 (strip) =>
                     [several ? element('h3', {}, runLabel(strip.run)) : null,
                      zoomSet(
                          6, strip.width, strip.height,
                          strip.pictures.map(
                              (at) => pane(at.picture, 'render', strip, `time ${at.time.toFixed(2)}`)))]),
           ] :
           null);

  const parameters = () => (
      record.histograms.length ?
          [
            note('The charts show activated values of all splats, with minimum, median and maximum below.'),
            legend(),
            of('charts small', record.histograms.map((h) => {
              const [low, high] = [h.edges[0], h.edges[h.edges.length - 1]];
              const datasets = h.runs.map(
                  (own) => ({
                    label: runs[own.run].name,
                    data: h.edges.map((x, i) => ({x, y: 100 * own.share[Math.min(i, own.share.length - 1)]})),
                    stepped: true,
                    borderColor: colour(own.run),
                    backgroundColor: `${colour(own.run)}${several ? '1c' : '38'}`,
                    borderWidth: several ? 1.6 : 1.2,
                    fill: 'origin',
                    pointRadius: 0,
                  }));
              const title = (items) => {
                if (!items.length) return '';
                const i =
                    Math.min(h.edges.findLastIndex((edge) => edge <= items[0].parsed.x), h.edges.length - 2);
                return `${short(h.edges[i])} to ${short(h.edges[i + 1])}`;
              };
              const figure = addChart(
                  h.name, axis(h.unit, h.logarithmic, {min: low, max: high}),
                  axis('share [%]', false, {min: 0}), datasets, title);
              figure.append(element(
                  'figcaption', {}, element('div', {}, h.meaning),
                  h.runs.map(
                      (own) => element(
                          'div', {},
                          labelled(
                              own.run,
                              `${short(own.minimum)} \u2026 ${short(own.median)} \u2026 ${
                                  short(own.maximum)}` +
                                  (own.outside ? `; ${own.outside} of ${own.values} beyond the axis` :
                                                 ''))))));
              return figure;
            })),
          ] :
          null);

  const viewTable = () => {
    const wide = (run) => list(find(run, 'test', 'wide_images')).map((image) => ({
      ...dict(image), name: `${dict(image).name} (wide image, with its own lens)`
    }));
    const measured = runs.map((run) => [...wide(run), ...measuredViews(run)]);
    const names = unique(measured.flatMap((views) => views.map((view) => view.name)));
    if (names.length === 0) return null;
    const columns = runs.flatMap(
        (_, r) => measureNames()
                      .filter((name) => !several || name === 'psnr' || name === 'ssim')
                      .map((name) => [r, name]));
    const rows = names.map((view) => [view, ...columns.map(([r, name]) => {
                             const value =
                                 dict(measured[r].find((own) => own.name === view))[name];
                             return [isNumber(value) ? fixed(value, measure(name)[2]) : nothing, 'number'];
                           })]);
    return element(
        'div', {}, element('h3', {}, 'Test views'),
        table(['view', ...columns.map(([r, name]) => [labelled(r, measure(name)[0]), 'number'])], rows));
  };
  const stageTable = () => {
    const stages = unique(runs.flatMap((run) => Object.keys(dict(find(run, 'minutes', 'stages')))));
    if (stages.length === 0) return null;
    const cell = (run, r, stage) => {
      const minutes = find(run, 'minutes', 'stages', stage), total = find(run, 'minutes', 'total');
      if (!isNumber(minutes) || !isNumber(total)) return [nothing, 'number'];
      const share = total > 0 ? Math.min(100, Math.max(0, 100 * minutes / total)) : 0;
      const bar = element('span', {});
      bar.style.width = `${share}%`;
      return [
        [
          `${fixed(60 * minutes, 2)} s, ${share.toFixed(1)} %`,
          toned(element('span', {class: 'track'}, bar), r)
        ],
        'number'
      ];
    };
    return element(
        'div', {}, element('h3', {}, 'Time by stage'),
        note('The times are estimated from sampled iterations. "other" is the rest of the training time.'),
        table(headOf('stage'), stages.map((stage) => [stage, ...runs.map((run, r) => cell(run, r, stage))])));
  };
  const dataNotes = () => {
    const items = runs.flatMap(
        (run,
         r) => [...list(find(run, 'data_report', 'notes')),
                ...list(find(run, 'data_report', 'skipped'))
                    .map((s) => `${valueText(dict(s).count, '')} skipped: ${valueText(dict(s).why, '')}`),
    ].filter((text) => typeof text === 'string')
                   .map((text) => element('li', {}, labelled(r, text))));
    return items.length ? [element('h3', {}, 'Loading the data'), element('ul', {}, items)] : null;
  };
  const measurements = () => {
    const tables = [viewTable(), stageTable()].filter((part) => part), notes = dataNotes();
    return tables.length || notes ? [of('side', tables), notes] : null;
  };

  const settings = () => {
    const keys = unique(runs.flatMap((run) => Object.keys(run.settings)));
    if (keys.length === 0) return null;
    const rows = keys.map((key) => {
      const known = Object.hasOwn(record.defaults, key),
            values = runs.map((run) => member(run.settings, key) ?? nothing);
      const byData = (run) =>
          // If ubs chose the value, it does not count as a setting that the user changed.
          list(find(run, 'chosen')).includes(key);
      const code = (value) => element('code', {}, value === '' ? '""' : value);
      return {
        cells:
            [code(key), ...values.map(code), known ? code(record.defaults[key]) : 'unknown to this version'],
        differ: values.some((value) => value !== values[0]),
        changed: !known || values.some((value, r) => value !== record.defaults[key] && !byData(runs[r])),
      };
    });
    const chosen = rows.filter((row) => row.differ || row.changed),
          others = rows.filter((row) => !chosen.includes(row));
    const head = () => [...headOf('setting'), 'default'];
    return [
      note(`These settings differ from their defaults${several ? '; rows in which the runs differ are marked' : ''}.`),
      table(head(), chosen.map((row) => row.cells), (r) => (chosen[r].differ ? 'differ' : '')),
      element(
          'details', {}, element('summary', {}, `Settings at their default (${others.length})`),
          table(head(), others.map((row) => row.cells)))
    ];
  };

  const device = () => {
    const rows = unique(runs.flatMap((run) => Object.keys(dict(find(run, 'device')))))
                     .map((key) => textRow(key, 'device', key));
    return [table(
        headOf('used for training'),
        [...rows, ['images of this page', ...runs.map((run) => run.drawn_on || nothing)]],
        (r) => (r < rows.length && rows[r].slice(1).some((cell) => cell !== rows[r][1]) ? 'differ' : ''))];
  };

  // ---- The page. The interactive viewer, if the document contains one, becomes the first section.
  const main = element('main', {}), links = [];
  document.body.append(main);
  if (record.viewer) {
    links.push(['viewer', 'The model']);
    main.append(element(
        'section', {id: 'viewer'}, element('h2', {}, 'The model'), document.getElementById('ubs-viewer'),
        note(`This is the model of ${runs[record.viewer.run].name} in compressed form. `,
             `PSNR against the original model: ${fixed(record.viewer.psnr, 1)} dB.`)));
  }
  for (const [id, title, content] of [
           ['summary', 'Summary', summary], ['curves', 'Training curves', curves], ['views', 'Views', views],
           ['decomposition', 'Decomposition', decomposition], ['times', 'Over time', times],
           ['parameters', 'Parameters', parameters], ['measurements', 'Measurements', measurements],
           ['settings', 'Settings', settings], ['device', 'Device', device]]) {
    const inside = content();
    if (!inside) continue;
    links.push([id, title]);
    main.append(element('section', {id}, element('h2', {}, title), inside));
  }
  const remarks =
      runs.flatMap((run, r) => run.remarks.map((remark) => element('li', {}, labelled(r, remark))));
  main.prepend(
      element(
          'header', {},
          element('p', {class: 'kicker'}, several ? 'Comparison of training runs' : 'Training run'),
          element('h1', {}, record.title), remarks.length ? element('ul', {class: 'remarks'}, remarks) : ''),
      element('nav', {}, links.map(([id, title]) => element('a', {href: `#${id}`}, title))));
  main.append(
      element('footer', {}, `Made by ${record.made_by}. Charts by Chart.js ${Chart.version}, MIT licence.`));
  showCharts();
}
