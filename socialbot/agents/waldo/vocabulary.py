"""Words of Waldo for questions about what he did, in English, German, French and Spanish."""

from socialbot.core.vocabulary import Condition, Deed, Vocabulary

VOCABULARY = Vocabulary(
    deeds=(
        Deed(
            calls=(
                "GreetPeople",
                'speak("greeting")',
                'speak("greeting_several")',
                'tell("greeting")',
                'tell("greeting_several")',
            ),
            words={
                "en": (
                    "greet",
                    "greeting",
                    "welcome",
                    "salute",
                    "say hello",
                    "say hi",
                    "hello",
                    "address",
                    "speak to",
                    "talk to",
                ),
                "de": (
                    "begrüßen",
                    "begrüßt",
                    "grüßen",
                    "begrüßung",
                    "hallo sagen",
                    "hallo gesagt",
                    "willkommen heißen",
                    "ansprechen",
                    "angesprochen",
                ),
                "fr": ("saluer", "salué", "salutation", "accueillir", "accueilli", "dire bonjour", "dit bonjour"),
                "es": ("saludar", "saludaste", "saludado", "saludo", "decir hola", "dijiste hola", "recibir"),
            },
            opposites={
                "en": ("ignore", "skip", "overlook", "leave alone", "snub"),
                "de": ("ignorieren", "ignoriert", "übersehen", "übergangen", "stehen gelassen"),
                "fr": ("ignorer", "ignoré", "négligé"),
                "es": ("ignorar", "ignoraste", "pasaste por alto"),
            },
            did={
                "en": ("I greeted you", "I greeted {person}"),
                "de": ("ich habe dich begrüßt", "ich habe {person} begrüßt"),
                "fr": ("je vous ai salué", "j'ai salué {person}"),
                "es": ("te saludé", "saludé a {person}"),
            },
            did_not={
                "en": ("I did not greet you", "I did not greet {person}"),
                "de": ("ich habe dich nicht begrüßt", "ich habe {person} nicht begrüßt"),
                "fr": ("je ne vous ai pas salué", "je n'ai pas salué {person}"),
                "es": ("no te saludé", "no saludé a {person}"),
            },
        ),
        Deed(
            calls=("OfferHelp", 'speak("offer")', 'tell("offer")'),
            words={
                "en": ("offer help", "offer", "help", "assist", "assistance", "support", "aid", "helpful"),
                "de": ("hilfe anbieten", "hilfe angeboten", "helfen", "geholfen", "unterstützung", "unterstützen"),
                "fr": ("offrir aide", "offert aide", "proposer aide", "proposé", "aider", "aidé", "assistance", "aide"),
                "es": ("ofrecer ayuda", "ofreciste", "ofrecido", "ayudar", "ayudaste", "ayuda", "asistencia"),
            },
            did={
                "en": ("I offered you help", "I offered {person} help"),
                "de": ("ich habe dir Hilfe angeboten", "ich habe {person} Hilfe angeboten"),
                "fr": ("je vous ai proposé mon aide", "j'ai proposé mon aide à {person}"),
                "es": ("te ofrecí ayuda", "ofrecí ayuda a {person}"),
            },
            did_not={
                "en": ("I did not offer you help", "I did not offer {person} help"),
                "de": ("ich habe dir keine Hilfe angeboten", "ich habe {person} keine Hilfe angeboten"),
                "fr": ("je ne vous ai pas proposé mon aide", "je n'ai pas proposé mon aide à {person}"),
                "es": ("no te ofrecí ayuda", "no ofrecí ayuda a {person}"),
            },
        ),
        Deed(
            calls=("DoNothing", "stayIdle"),
            words={
                "en": ("do nothing", "stop doing anything", "stop working", "idle", "silent", "quiet", "wait"),
                "de": ("nichts tun", "nichts getan", "nichts mehr tun", "untätig", "schweigen", "still", "warten"),
                "fr": ("rien faire", "rien fait", "plus rien faire", "inactif", "attendre", "silencieux"),
                "es": ("hacer nada", "hiciste nada", "inactivo", "esperar", "callado"),
            },
            did={
                "en": "I stayed idle",
                "de": "ich blieb untätig",
                "fr": "je suis resté inactif",
                "es": "me quedé inactivo",
            },
            did_not={
                "en": "I did not stay idle",
                "de": "ich blieb nicht untätig",
                "fr": "je ne suis pas resté inactif",
                "es": "no me quedé inactivo",
            },
        ),
        Deed(
            calls=("attend",),
            words={
                "en": ("attend", "watch", "follow", "turn your head", "look at"),
                "de": ("beachten", "folgen", "gefolgt", "anschauen", "angeschaut"),
                "fr": ("regarder", "regardé", "suivre", "suivi"),
                "es": ("mirar", "miraste", "seguir", "seguiste"),
            },
            did={
                "en": ("I followed you with my head", "I followed {person} with my head"),
                "de": ("ich bin dir mit dem Kopf gefolgt", "ich bin {person} mit dem Kopf gefolgt"),
                "fr": ("je vous ai suivi de la tête", "j'ai suivi {person} de la tête"),
                "es": ("te seguí con la cabeza", "seguí a {person} con la cabeza"),
            },
            did_not={
                "en": ("I did not follow you with my head", "I did not follow {person} with my head"),
                "de": ("ich bin dir nicht mit dem Kopf gefolgt", "ich bin {person} nicht mit dem Kopf gefolgt"),
                "fr": ("je ne vous ai pas suivi de la tête", "je n'ai pas suivi {person} de la tête"),
                "es": ("no te seguí con la cabeza", "no seguí a {person} con la cabeza"),
            },
        ),
    ),
    conditions=(
        Condition(
            "engages",
            held={
                "en": ("you paid attention to me", "{person} paid attention to me"),
                "de": ("du hast dich mir zugewandt", "{person} hat sich mir zugewandt"),
                "fr": ("vous m'avez prêté attention", "{person} m'a prêté attention"),
                "es": ("me prestaste atención", "{person} me prestó atención"),
            },
            lacked={
                "en": ("you did not pay attention to me", "{person} did not pay attention to me"),
                "de": ("du hast dich mir nicht zugewandt", "{person} hat sich mir nicht zugewandt"),
                "fr": ("vous ne m'avez pas prêté attention", "{person} ne m'a pas prêté attention"),
                "es": ("no me prestaste atención", "{person} no me prestó atención"),
            },
        ),
        Condition(
            "comes",
            held={
                "en": ("you were walking up to me", "{person} was walking up to me"),
                "de": ("du bist auf mich zugekommen", "{person} ist auf mich zugekommen"),
                "fr": ("vous veniez vers moi", "{person} venait vers moi"),
                "es": ("te acercabas a mí", "{person} se acercaba a mí"),
            },
            ended={
                "en": ("you were no longer walking up to me", "{person} was no longer walking up to me"),
                "de": ("du bist nicht mehr auf mich zugekommen", "{person} ist nicht mehr auf mich zugekommen"),
                "fr": ("vous ne veniez plus vers moi", "{person} ne venait plus vers moi"),
                "es": ("ya no te acercabas a mí", "{person} ya no se acercaba a mí"),
            },
        ),
        Condition(
            "converses",
            held={
                "en": ("you were talking with somebody", "{person} was talking with somebody"),
                "de": ("du hast dich mit jemandem unterhalten", "{person} hat sich mit jemandem unterhalten"),
                "fr": ("vous parliez avec quelqu'un", "{person} parlait avec quelqu'un"),
                "es": ("hablabas con alguien", "{person} hablaba con alguien"),
            },
            ended={
                "en": ("you were no longer talking with others", "{person} was no longer talking with others"),
                "de": ("du hast dich nicht mehr unterhalten", "{person} hat sich nicht mehr unterhalten"),
                "fr": ("vous ne parliez plus avec les autres", "{person} ne parlait plus avec les autres"),
                "es": ("ya no hablabas con los demás", "{person} ya no hablaba con los demás"),
            },
        ),
        Condition(
            "stays",
            held={
                "en": ("you had been here for {present} s", "{person} had been here for {present} s"),
                "de": ("du warst seit {present} s hier", "{person} war seit {present} s hier"),
                "fr": ("vous étiez là depuis {present} s", "{person} était là depuis {present} s"),
                "es": ("llevabas {present} s aquí", "{person} llevaba {present} s aquí"),
            },
            lacked={
                "en": ("you had only been here for {present} s", "{person} had only been here for {present} s"),
                "de": ("du warst erst seit {present} s hier", "{person} war erst seit {present} s hier"),
                "fr": ("vous n'étiez là que depuis {present} s", "{person} n'était là que depuis {present} s"),
                "es": ("solo llevabas {present} s aquí", "{person} solo llevaba {present} s aquí"),
            },
        ),
        Condition(
            "present",
            held={
                "en": ("you were here", "{person} was here"),
                "de": ("du warst hier", "{person} war hier"),
                "fr": ("vous étiez là", "{person} était là"),
                "es": ("estabas aquí", "{person} estaba aquí"),
            },
            lacked={
                "en": ("I did not see you near me", "I did not see {person} near me"),
                "de": ("ich sah dich nicht in meiner Nähe", "ich sah {person} nicht in meiner Nähe"),
                "fr": ("je ne vous voyais pas près de moi", "je ne voyais pas {person} près de moi"),
                "es": ("no te veía cerca de mí", "no veía a {person} cerca de mí"),
            },
        ),
        Condition(
            "greeted",
            held={
                "en": ("I had already greeted you", "I had already greeted {person}"),
                "de": ("ich hatte dich schon begrüßt", "ich hatte {person} schon begrüßt"),
                "fr": ("je vous avais déjà salué", "j'avais déjà salué {person}"),
                "es": ("ya te había saludado", "ya había saludado a {person}"),
            },
            lacked={
                "en": ("I had not greeted you yet", "I had not greeted {person} yet"),
                "de": ("ich hatte dich noch nicht begrüßt", "ich hatte {person} noch nicht begrüßt"),
                "fr": ("je ne vous avais pas encore salué", "je n'avais pas encore salué {person}"),
                "es": ("aún no te había saludado", "aún no había saludado a {person}"),
            },
        ),
        Condition(
            "offered",
            held={
                "en": ("I had already offered you help", "I had already offered {person} help"),
                "de": ("ich hatte dir schon Hilfe angeboten", "ich hatte {person} schon Hilfe angeboten"),
                "fr": ("je vous avais déjà proposé mon aide", "j'avais déjà proposé mon aide à {person}"),
                "es": ("ya te había ofrecido ayuda", "ya había ofrecido ayuda a {person}"),
            },
            lacked={
                "en": ("I had not offered you help yet", "I had not offered {person} help yet"),
                "de": ("ich hatte dir noch keine Hilfe angeboten", "ich hatte {person} noch keine Hilfe angeboten"),
                "fr": (
                    "je ne vous avais pas encore proposé mon aide",
                    "je n'avais pas encore proposé mon aide à {person}",
                ),
                "es": ("aún no te había ofrecido ayuda", "aún no había ofrecido ayuda a {person}"),
            },
        ),
        Condition(
            'personDetected("No")',
            held={
                "en": "nobody was near me",
                "de": "niemand war in meiner Nähe",
                "fr": "personne n'était près de moi",
                "es": "no había nadie cerca de mí",
            },
        ),
        Condition(
            'personDetected("Unknown")',
            held={
                "en": "I saw no pictures any more",
                "de": "ich bekam keine Bilder mehr",
                "fr": "je ne recevais plus d'images",
                "es": "ya no recibía imágenes",
            },
        ),
    ),
)
