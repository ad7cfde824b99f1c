/* A particle on a spring in polar coordinates, as an FMU for model exchange: FMI 2, or 3 with -DFMI3. */
#include <math.h>
#include <stdlib.h>

#ifndef WEIGHT
#define WEIGHT 9.81
#endif

typedef struct { double t, x[4]; } Unit;

static void rates(const Unit *c, double *dx) {
    const double m = 2.0, k = 80.0, l0 = 0.4;
    double va = c->x[0], r = c->x[1], vr = c->x[2], a = c->x[3];
    dx[3] = va;
    dx[1] = vr;
    dx[2] = r * va * va + WEIGHT * cos(a) - k * (r - l0) / m;
    dx[0] = -(2.0 * vr * va + WEIGHT * sin(a)) / r;
}

#ifdef FMI3
#define T(name) fmi3##name
typedef void *Env;
void *fmi3InstantiateModelExchange(const char *n, const char *tk, const char *res, int vis, int log, Env env, void *cb)
{ Unit *c = calloc(1, sizeof(Unit)); c->x[1] = 0.5; return c; }
int fmi3EnterInitializationMode(void *c, int td, double tol, double t, int sd, double stop) { return 0; }
int fmi3UpdateDiscreteStates(void *c, int *a, int *b, int *d, int *e, int *f, double *g)
{ *a = *b = *d = *e = *f = 0; *g = 0; return 0; }
int fmi3GetContinuousStateDerivatives(void *c, double *dx, size_t n) { rates(c, dx); return 0; }
#else
#define T(name) fmi2##name
typedef struct { int a, b, d, e, f; double g; } Info;
void *fmi2Instantiate(const char *n, int type, const char *guid, const char *res, const void *cb, int vis, int log)
{ Unit *c = calloc(1, sizeof(Unit)); c->x[1] = 0.5; return c; }
int fmi2SetupExperiment(void *c, int td, double tol, double t, int sd, double stop) { return 0; }
int fmi2EnterInitializationMode(void *c) { return 0; }
int fmi2NewDiscreteStates(void *c, Info *i) { i->a = i->b = i->d = i->e = i->f = 0; return 0; }
int fmi2GetDerivatives(void *c, double *dx, size_t n) { rates(c, dx); return 0; }
#endif

int T(ExitInitializationMode)(void *c) { return 0; }
int T(EnterContinuousTimeMode)(void *c) { return 0; }
int T(SetTime)(void *c, double t) { ((Unit *)c)->t = t; return 0; }
int T(SetContinuousStates)(void *c, const double *x, size_t n)
{ for (size_t i = 0; i < n; i++) ((Unit *)c)->x[i] = x[i]; return 0; }
int T(Terminate)(void *c) { return 0; }
void T(FreeInstance)(void *c) { free(c); }
